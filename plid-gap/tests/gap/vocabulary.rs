//! The book lists every effect of the vocabulary.

use std::fs;
use std::path::Path;

use plid_gap::effects::Library;

#[test]
fn the_book_lists_every_effect_once() {
    let book = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/gap-effects.md");
    let text = fs::read_to_string(book).unwrap();
    let rows = |name: &str| text.lines().filter(|line| line.starts_with(&format!("| `{name}` |"))).count();
    let library = Library::standard();
    let wrong: Vec<&str> = library.effects().map(|effect| effect.name()).filter(|name| rows(name) != 1).collect();
    assert!(wrong.is_empty(), "docs/gap-effects.md has no row, or several, of {wrong:#?}");
}
