use std::path::Path;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::figure::CLIP_PREFIX;
use super::write_atomic;

/// A report, which is built from top to bottom and written as one HTML page that loads no other file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    title: String,
    verdict: Vec<String>,
    blocks: Vec<Block>,
    provenance: Vec<(String, String)>,
}

#[derive(Debug, Clone, PartialEq)]
enum Block {
    Heading(String),
    Paragraph(String),
    Figure { svg: String, caption: String },
    Table(Table),
    List { kind: &'static str, heading: &'static str, items: Vec<String> },
    Details { summary: String, blocks: Vec<Block> },
    Listing { caption: String, text: String },
}

/// A table with a caption.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    caption: String,
    columns: Vec<(String, String)>,
    rows: Vec<Vec<Cell>>,
}

/// One cell of a table. Numbers are aligned to the right.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Text.
    Text(String),
    /// A number as it is shown.
    Number(String),
}

impl Cell {
    /// Formats a number with this many decimals. NaN is shown as a dash and an infinite number as ∞.
    pub fn fixed(value: f64, decimals: usize) -> Self {
        Self::Number(if value.is_finite() { format!("{value:.decimals$}") } else { not_finite(value) })
    }

    /// Formats a number with this many significant digits.
    pub fn significant(value: f64, digits: usize) -> Self {
        if !value.is_finite() {
            return Self::Number(not_finite(value));
        }
        let exponent = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
        if !(-4..6).contains(&exponent) {
            return Self::Number(format!("{value:.*e}", digits.saturating_sub(1)));
        }
        let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
        Self::Number(format!("{value:.decimals$}"))
    }

    /// Formats a value with its standard deviation, both rounded to two digits of the standard deviation.
    pub fn with_std(value: f64, std: f64) -> Self {
        if !value.is_finite() || !std.is_finite() || std <= 0.0 {
            return Self::significant(value, 5);
        }
        let decimals = (1 - std.log10().floor() as i32).clamp(0, 12) as usize;
        Self::Number(format!("{value:.decimals$} ± {std:.decimals$}"))
    }
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (Self::Text(text) | Self::Number(text)) = self;
        f.write_str(text)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Self {
        Self::Number(count.to_string())
    }
}

fn not_finite(value: f64) -> String {
    if value.is_nan() { "–".into() } else { "∞".into() }
}

impl Table {
    /// Creates an empty table.
    pub fn new(caption: impl Into<String>) -> Self {
        Self { caption: caption.into(), ..Self::default() }
    }

    /// Adds a column; the unit may be empty.
    pub fn column(mut self, name: impl Into<String>, unit: impl Into<String>) -> Self {
        self.columns.push((name.into(), unit.into()));
        self
    }

    /// Adds a row. Cells beyond the last column are dropped, and missing cells are blank.
    pub fn row(mut self, cells: impl IntoIterator<Item = Cell>) -> Self {
        self.rows.push(cells.into_iter().collect());
        self
    }
}

impl Report {
    /// Creates an empty report.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// Adds a sentence to the verdict at the top of the page.
    pub fn verdict(mut self, sentence: impl Into<String>) -> Self {
        self.verdict.push(sentence.into());
        self
    }

    /// Adds a heading.
    pub fn heading(self, text: impl Into<String>) -> Self {
        self.push(Block::Heading(text.into()))
    }

    /// Adds a paragraph.
    pub fn paragraph(self, text: impl Into<String>) -> Self {
        self.push(Block::Paragraph(text.into()))
    }

    /// Adds a plot from a plot function of this crate, with a caption below it. The SVG is not escaped.
    pub fn figure(self, svg: impl Into<String>, caption: impl Into<String>) -> Self {
        self.push(Block::Figure { svg: svg.into(), caption: caption.into() })
    }

    /// Adds a table.
    pub fn table(self, table: Table) -> Self {
        self.push(Block::Table(table))
    }

    /// Adds a list of warnings, unless it is empty.
    pub fn warnings(self, items: impl IntoIterator<Item = impl Into<String>>) -> Self {
        self.list("warnings", "Warnings", items)
    }

    /// Adds a list of advice, unless it is empty.
    pub fn advice(self, items: impl IntoIterator<Item = impl Into<String>>) -> Self {
        self.list("advice", "Advice", items)
    }

    /// Adds a section that is collapsed until the reader opens it. `fill` receives an empty report, of which only the
    /// blocks are used.
    pub fn details(self, summary: impl Into<String>, fill: impl FnOnce(Self) -> Self) -> Self {
        let blocks = fill(Self::default()).blocks;
        self.push(Block::Details { summary: summary.into(), blocks })
    }

    /// Adds a text to copy, such as a config. One click selects all of it.
    pub fn listing(self, caption: impl Into<String>, text: impl Into<String>) -> Self {
        self.push(Block::Listing { caption: caption.into(), text: text.into() })
    }

    /// Adds a line to the footer, such as the version or the hash of an input file.
    pub fn provenance(mut self, name: impl Into<String>, value: impl Into<String>) -> Self {
        self.provenance.push((name.into(), value.into()));
        self
    }

    fn push(mut self, block: Block) -> Self {
        self.blocks.push(block);
        self
    }

    fn list(
        self,
        kind: &'static str,
        heading: &'static str,
        items: impl IntoIterator<Item = impl Into<String>>,
    ) -> Self {
        let items: Vec<String> = items.into_iter().map(Into::into).collect();
        if items.is_empty() { self } else { self.push(Block::List { kind, heading, items }) }
    }

    /// Returns the page. The same report gives the same bytes.
    pub fn to_html(&self) -> String {
        let figures = std::cell::Cell::new(0);
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    title { (self.title) }
                    style { (PreEscaped(include_str!("page.css"))) }
                }
                body {
                    main {
                        h1 { (self.title) }
                        @if !self.verdict.is_empty() {
                            div.verdict { @for sentence in &self.verdict { p { (sentence) } } }
                        }
                        @for block in &self.blocks { (block.html(&figures)) }
                        @if !self.provenance.is_empty() {
                            footer { dl { @for (name, value) in &self.provenance { dt { (name) } dd { (value) } } } }
                        }
                    }
                }
            }
        };
        page.into_string()
    }

    /// Writes the page to a file atomically.
    ///
    /// # Errors
    /// Returns the error of the file system.
    pub fn write(&self, path: &Path) -> std::io::Result<()> {
        write_atomic(path, self.to_html().as_bytes())
    }
}

impl Block {
    /// Returns the HTML of a block. `figures` counts the figures of the page so far.
    fn html(&self, figures: &std::cell::Cell<usize>) -> Markup {
        match self {
            Self::Heading(text) => html! { h2 { (text) } },
            Self::Paragraph(text) => html! { p { (text) } },
            Self::Figure { svg, caption } => {
                figures.set(figures.get() + 1);
                // Names within an SVG are names within the page.
                let svg = svg.replace(CLIP_PREFIX, &format!("{CLIP_PREFIX}{}-", figures.get()));
                html! { figure { (PreEscaped(svg)) figcaption { (caption) } } }
            }
            Self::Table(table) => table.html(),
            Self::List { kind, heading, items } => html! {
                section class=(kind) { h3 { (heading) } ul { @for item in items { li { (item) } } } }
            },
            Self::Details { summary, blocks } => html! {
                details { summary { (summary) } @for block in blocks { (block.html(figures)) } }
            },
            Self::Listing { caption, text } => html! {
                p { (caption) }
                // HTML ignores a line feed right after the tag, so an additional one is written.
                pre { "\n" (text) }
            },
        }
    }
}

impl Table {
    fn html(&self) -> Markup {
        let numeric =
            |j: usize| self.rows.iter().filter_map(|row| row.get(j)).any(|cell| matches!(cell, Cell::Number(_)));
        html! {
            div.table {
                table {
                    caption { (self.caption) }
                    thead {
                        tr {
                            @for (j, (name, unit)) in self.columns.iter().enumerate() {
                                th scope="col" class=[numeric(j).then_some("number")] {
                                    (name) @if !unit.is_empty() { span.unit { (unit) } }
                                }
                            }
                        }
                    }
                    tbody {
                        @for row in &self.rows {
                            tr {
                                @for j in 0..self.columns.len() {
                                    td class=[matches!(row.get(j), Some(Cell::Number(_))).then_some("number")] {
                                        @if let Some(cell) = row.get(j) { (cell.to_string()) }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, Chart, Series, chart};

    fn example() -> Report {
        let svg = chart(&Chart {
            title: String::new(),
            x: Axis::linear("x"),
            y: Axis::linear("y"),
            series: vec![Series::line("a", vec![(0.0, 0.0), (1.0, 1.0)])],
            height: 100.0,
        });
        Report::new("A <b> & c")
            .verdict("Good & well.")
            .figure(svg.clone(), "One < two.")
            .table(
                Table::new("T")
                    .column("mode", "")
                    .column("f", "Hz")
                    .row(["a".into(), Cell::fixed(1.5, 2)])
                    .row(["<i>".into()]),
            )
            .warnings(["beware <script>alert(1)</script>"])
            .advice(Vec::<String>::new())
            .details("more", |r| r.figure(svg, "again").paragraph("p"))
            .listing("The config.", "name = \"<x>\"\n")
            .provenance("version", "0.1.0")
    }

    #[test]
    fn everything_is_escaped_and_nothing_is_loaded() {
        let page = example().to_html();
        assert!(
            page.contains("<h1>A &lt;b&gt; &amp; c</h1>") && page.contains("&lt;script&gt;alert(1)&lt;/script&gt;")
        );
        assert!(!page.contains("<script") && !page.contains("<i>") && !page.contains("Advice"));
        assert!(page.contains("name = &quot;&lt;x&gt;&quot;"));
        // The only addresses are those of XML namespaces.
        assert!(!page.contains("https://") && !page.contains("src=") && !page.contains("href="));
        assert_eq!(page.matches("http://").count(), page.matches("xmlns=\"http://www.w3.org/2000/svg\"").count());
    }

    #[test]
    fn names_of_clip_paths_differ_between_figures_and_the_page_repeats() {
        let page = example().to_html();
        assert_eq!(page, example().to_html());
        for id in ["plid-clip-1-0", "plid-clip-2-0"] {
            assert_eq!(page.matches(&format!("id=\"{id}\"")).count(), 1);
            assert_eq!(page.matches(&format!("url(#{id})")).count(), 1);
        }
    }

    #[test]
    fn a_wide_table_stays_in_the_page() {
        let page = example().to_html();
        assert_eq!(page.matches("<table>").count(), page.matches("<div class=\"table\"><table>").count());
        let style = include_str!("page.css");
        assert!(style.contains(".table { overflow-x: auto;"), "it scrolls on the screen");
        let print = &style[style.find("@media print").unwrap()..];
        assert!(print.contains("td, th { overflow-wrap: anywhere; }"), "it wraps on paper");
    }

    #[test]
    fn opened_tags_are_closed() {
        let page = example().to_html();
        for tag in
            ["main", "figure", "table", "tr", "td", "section", "ul", "details", "pre", "footer", "svg", "g", "defs"]
        {
            let opened = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
            assert!(opened > 0, "{tag}");
        }
    }

    #[test]
    fn numbers_are_set_as_asked() {
        let text = |cell: Cell| match cell {
            Cell::Number(text) | Cell::Text(text) => text,
        };
        assert_eq!(text(Cell::fixed(2.0, 3)), "2.000");
        assert_eq!(text(Cell::fixed(f64::NAN, 3)), "–");
        assert_eq!(text(Cell::significant(0.012345, 3)), "0.0123");
        assert_eq!(text(Cell::significant(1.5e-9, 2)), "1.5e-9");
        assert_eq!(text(Cell::significant(0.0, 3)), "0.00");
        assert_eq!(text(Cell::significant(f64::INFINITY, 3)), "∞");
        assert_eq!(text(Cell::with_std(136.0213, 0.0123)), "136.021 ± 0.012");
        assert_eq!(text(Cell::with_std(1234.5, 55.0)), "1234 ± 55");
    }
}
