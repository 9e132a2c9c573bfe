/// Returns the name of a file or folder for any text. Each byte that could lead to another folder, or that a file
/// system rejects, is replaced by `%` and two hexadecimal digits. Different texts give different names.
#[must_use]
pub fn file_name(text: &str) -> String {
    if text.is_empty() {
        return "%".into();
    }
    let mut name = String::new();
    let last = text.len() - 1;
    for (at, c) in text.char_indices() {
        let at_an_end = (at == 0 && c == '.') || (at == last && matches!(c, '.' | ' '));
        if "/\\:*?\"<>|%".contains(c) || c.is_control() || at_an_end {
            let mut bytes = [0; 4];
            name.extend(c.encode_utf8(&mut bytes).bytes().map(|byte| format!("%{byte:02X}")));
        } else {
            name.push(c);
        }
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_name_stays_in_its_folder() {
        for (text, expected) in [
            ("u1", "u1"),
            ("force [N]", "force [N]"),
            ("Kraft ö", "Kraft ö"),
            ("../../x", "%2E.%2F..%2Fx"),
            ("/etc", "%2Fetc"),
            ("..", "%2E%2E"),
            ("a.", "a%2E"),
            ("a\\b", "a%5Cb"),
            ("%2F", "%252F"),
            ("C:", "C%3A"),
            ("a\u{85}", "a%C2%85"),
            ("", "%"),
        ] {
            assert_eq!(file_name(text), expected);
            assert_eq!(Path::new("runs").join(file_name(text)).components().count(), 2, "{text}");
        }
    }
}
