//! Every key of a trial has an entry in the book.

use std::path::Path;

use plid_trial::config::{Cases, Draw};

#[test]
fn every_key_of_a_trial_is_documented() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let book = here.ancestors().map(|folder| folder.join("docs/trust.md")).find(|chapter| chapter.exists());
    let text = std::fs::read_to_string(book.expect("the book")).unwrap();
    let tables =
        [("[cases]", serde_json::to_value(Cases::default())), ("[draw]", serde_json::to_value(Draw::default()))];
    for (title, keys) in tables {
        // The table in the first listing that has it, up to an empty line or the end of the listing.
        let lines = text.lines().skip_while(|line| line.split('#').next().unwrap().trim() != title).skip(1);
        let table: Vec<&str> = lines.take_while(|line| !line.is_empty() && !line.starts_with("```")).collect();
        for key in keys.unwrap().as_object().unwrap().keys() {
            let is_listed = table.iter().any(|line| line.split_once(" = ").is_some_and(|(name, _)| name == key));
            assert!(is_listed, "docs/trust.md lacks `{key}` under {title}: {table:#?}");
        }
    }
}
