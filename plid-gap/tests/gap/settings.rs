//! The book contains every threshold of the diagnosis as it is in the code.

use std::fs;
use std::path::Path;

use plid_gap::settings::{Field, GapSettings};

const HEAD: &str = "# Thresholds of the diagnosis

A diagnosis decides by the thresholds below. A case may set each of them in the table of its group; an unknown key or
a value out of its range is an error. All of them are written to `settings` in `diagnosis.json`.

```toml
[settings.judge]
most_unknown = 0.5
```

2 ln L is twice a difference in log likelihood.

A number is a setting if it decides what the diagnosis says: with another value, another statement would be made about
the same records. Its reason and its source are given in the code and in the tables below. A number that only controls a
computation is defined next to its algorithm, with a comment that gives its reason. Such numbers are steps of finite
differences, limits of iterations, lengths of segments, rounding tolerances, the shapes of starting values, and numbers
of rows in a report. The limits within which the parameters of an effect mean what its name says are in the file of the
effect.

This chapter is generated from the code. After a change there, run
`UPDATE_BOOK=1 cargo test -p plid-gap --test gap settings`.
";

fn row(field: &Field) -> String {
    let range = format!("{} to {}", number(*field.range.start()), number(*field.range.end()));
    let about = field.about.split_whitespace().collect::<Vec<_>>().join(" ");
    format!("| `{}` | {} | {} | {range} | {about} |\n", field.key, number(field.value), field.unit)
}

fn number(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

fn chapter() -> String {
    let groups = GapSettings::default().groups().into_iter().map(|(group, fields)| {
        let rows: String = fields.iter().map(row).collect();
        format!(
            "\n## `[settings.{group}]`\n\n| key | default | unit | range | meaning |\n|---|---|---|---|---|\n{rows}"
        )
    });
    std::iter::once(HEAD.to_string()).chain(groups).collect()
}

#[test]
fn the_book_has_every_threshold() {
    let book = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/gap-settings.md");
    if std::env::var_os("UPDATE_BOOK").is_some() {
        fs::write(&book, chapter()).unwrap();
    }
    let written = fs::read_to_string(&book).unwrap();
    let differs = written.lines().zip(chapter().lines().map(String::from)).find(|(a, b)| a != b);
    assert!(written == chapter(), "docs/gap-settings.md is not that of the code: {differs:?}");
}
