//! The common style of all plots. The colours are those of Okabe and Ito, which colour-blind readers can distinguish.

/// Measured data: grey and wide, drawn below the models so that it remains visible.
pub const MEASURED: &str = "#8f8f8f";
/// The identified model and its one-step prediction.
pub const IDENTIFIED: &str = "#0072b2";
/// The true model, where one is known.
pub const TRUE_MODEL: &str = "#d55e00";
/// Free-run simulation.
pub const FREE_RUN: &str = "#e69f00";
/// Coherence.
pub const COHERENCE: &str = "#009e73";
/// Bounds, floors and other reference lines.
pub const REFERENCE: &str = "#d55e00";

/// Colours that are assigned in turn to series without a colour.
pub const CYCLE: [&str; 8] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#4d4d4d", "#8c6d1f"];

pub const GRID: &str = "#e6e6e6";
pub const AXIS: &str = "#555555";
pub const TEXT: &str = "#222222";
pub const FONT: &str = "DejaVu Sans, Verdana, Helvetica, Arial, sans-serif";

/// Width of a figure in pixels.
pub const WIDTH: f64 = 900.0;
pub const TICK_SIZE: u32 = 11;
pub const LABEL_SIZE: u32 = 12;
pub const TITLE_SIZE: u32 = 13;
pub const LINE: f64 = 1.4;
pub const BAND_OPACITY: f64 = 0.22;

/// Estimates the width of a text in pixels, accurately enough to place texts side by side.
pub fn text_width(text: &str, size: u32) -> f64 {
    text.chars().count() as f64 * size as f64 * 0.57
}

/// Shortens a text to this many pixels by omitting its middle, because names differ at both ends.
pub fn fitted(text: &str, size: u32, width: f64) -> String {
    let most = (width / (f64::from(size) * 0.57)).max(3.0) as usize;
    let letters: Vec<char> = text.chars().collect();
    if letters.len() <= most {
        return text.into();
    }
    let (head, tail) = (most / 2, (most - 1) / 2);
    let ends = |letters: &[char]| letters.iter().collect::<String>();
    format!("{}…{}", ends(&letters[..head]).trim_end(), ends(&letters[letters.len() - tail..]).trim_start())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_keep_both_ends_and_short_ones_all() {
        assert_eq!(fitted("record-1.csv", LABEL_SIZE, 200.0), "record-1.csv");
        let short = fitted("F16Data_FullMSine_Level1.csv, rows 49152 to 73728", LABEL_SIZE, 150.0);
        assert!(
            text_width(&short, LABEL_SIZE) <= 150.0 && short.starts_with("F16D") && short.ends_with("73728"),
            "{short}"
        );
    }
}
