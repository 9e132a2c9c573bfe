//! A plot of a table of classes. A colour and a word show the class, and a second line shows the step.

use maud::{Markup, html};

use super::classify::Class;

/// The contents of a field.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// The class, which determines colour and word.
    pub class: Class,
    /// A short second line.
    pub note: String,
}

/// Rows and columns of fields; `None` is blank.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Names of the rows.
    pub rows: Vec<String>,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// The label of the columns.
    pub column_label: String,
    /// `rows` x `columns`.
    pub fields: Vec<Vec<Option<Field>>>,
}

const WIDTH: f64 = 900.0;
const LEFT: f64 = 170.0;
const HEIGHT: f64 = 36.0;
const TOP: f64 = 58.0;

fn look(class: Class) -> (&'static str, &'static str, &'static str) {
    match class {
        Class::Sound => ("#009e73", "#ffffff", "sound"),
        Class::Degraded => ("#f0c96a", "#222222", "degraded"),
        Class::Lost => ("#d55e00", "#ffffff", "lost"),
    }
}

/// Returns the grid as SVG.
pub fn draw(grid: &Grid) -> String {
    let width = (WIDTH - LEFT - 10.0) / grid.columns.len().max(1) as f64;
    let height = TOP + HEIGHT * grid.rows.len() as f64 + 8.0;
    let svg = html! {
        svg viewBox=(format!("0 0 {WIDTH:.2} {height:.2}")) width=(WIDTH) height=(height)
            xmlns="http://www.w3.org/2000/svg"
            font-family="DejaVu Sans, Verdana, Helvetica, Arial, sans-serif" font-size="12" fill="#222222" {
            (text(LEFT + width * grid.columns.len() as f64 / 2.0, 14.0, "middle", &grid.column_label))
            @for (j, name) in grid.columns.iter().enumerate() {
                // A name of two words takes two lines.
                @for (line, word) in name.split(' ').enumerate() {
                    (text(LEFT + (j as f64 + 0.5) * width, 34.0 + 15.0 * line as f64, "middle", word))
                }
            }
            @for (i, name) in grid.rows.iter().enumerate() {
                (text(LEFT - 10.0, TOP + (i as f64 + 0.5) * HEIGHT + 4.0, "end", name))
            }
            @for (i, row) in grid.fields.iter().enumerate() {
                @for (j, field) in row.iter().enumerate() {
                    @if let Some(field) = field {
                        (draw_field(field, LEFT + j as f64 * width, TOP + i as f64 * HEIGHT, width))
                    }
                }
            }
        }
    };
    svg.into_string()
}

fn text(x: f64, y: f64, anchor: &str, words: &str) -> Markup {
    html! { text x=(format!("{x:.1}")) y=(format!("{y:.1}")) text-anchor=(anchor) { (words) } }
}

fn draw_field(field: &Field, x: f64, y: f64, width: f64) -> Markup {
    let (fill, ink, word) = look(field.class);
    let [left, top, wide, high] = [x + 1.0, y + 1.0, width - 2.0, HEIGHT - 2.0].map(|v| format!("{v:.1}"));
    let lines = if field.note.is_empty() { vec![(word, 22.0)] } else { vec![(word, 15.0), (&*field.note, 29.0)] };
    html! {
        rect x=(left) y=(top) width=(wide) height=(high) fill=(fill) {}
        @for (words, down) in lines {
            text x=(format!("{:.1}", x + width / 2.0)) y=(format!("{:.1}", y + down)) fill=(ink) font-size="11"
                text-anchor="middle" { (words) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_has_its_class_and_note_and_a_gap_has_nothing() {
        let field = |class, note: &str| Some(Field { class, note: note.into() });
        let svg = draw(&Grid {
            rows: vec!["a<b".into(), "c".into()],
            columns: vec!["12".into(), "24".into()],
            column_label: "states".into(),
            fields: vec![
                vec![field(Class::Sound, ""), field(Class::Lost, "step 328")],
                vec![None, field(Class::Degraded, "")],
            ],
        });
        assert_eq!(svg.matches("<rect").count(), 3);
        for (word, count) in [(">sound<", 1), (">lost<", 1), (">step 328<", 1), (">degraded<", 1), ("a&lt;b", 1)] {
            assert_eq!(svg.matches(word).count(), count, "{word}");
        }
    }
}
