use std::sync::Arc;

use kuva::render::layout::TickFormat;

use super::panel::Scale;

/// Returns the step of 1, 2 or 5 times a power of ten that gives about `count` ticks on the range.
pub(super) fn nice_step(range: (f64, f64), count: f64) -> f64 {
    let raw = (range.1 - range.0) / count;
    let power = 10f64.powf(raw.log10().floor());
    let off = |factor: &f64| (factor * power / raw).ln().abs();
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(1.0);
    factor * power
}

/// Returns a power of ten that scales the axis to numbers that the plotting library can draw. The library accepts
/// nothing below 1e-10 on a logarithmic axis, and no span near the smallest number on a linear one.
pub(super) fn drawing_factor(scale: Scale, range: (f64, f64)) -> f64 {
    let size = match scale {
        Scale::Linear => range.0.abs().max(range.1.abs()),
        Scale::Log => range.0,
    };
    if !(1e-6..1e9).contains(&size) && size > 0.0 {
        10f64.powi(-(size.log10().floor() as i32).clamp(-290, 290))
    } else {
        1.0
    }
}

/// Returns the labels of ticks on an axis scaled by `factor`. On a logarithmic axis only some decades have a label.
pub(super) fn tick_format(factor: f64, every: i32) -> TickFormat {
    TickFormat::Custom(Arc::new(move |value| {
        let value = value / factor;
        let unmarked = every > 1 && (value.log10().round() as i32) % every != 0;
        if unmarked { String::new() } else { format_tick(value) }
    }))
}

/// Returns the label of a tick: a plain number if it is short, and a power of ten otherwise.
pub(super) fn format_tick(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    // Ticks are sums of steps. Rounding to ten digits removes the error of the sums.
    let text = format!("{:.9e}", value);
    let Some((mantissa, exponent)) = text.split_once('e') else {
        return text;
    };
    let mantissa = trim_zeros(mantissa);
    let Ok(exponent) = exponent.parse::<i32>() else {
        return text;
    };
    if (-3..5).contains(&exponent) {
        return trim_zeros(&format!("{:.*}", (9 - exponent) as usize, value)).replace('-', "\u{2212}");
    }
    let sign = if mantissa.starts_with('-') { "\u{2212}" } else { "" };
    let mantissa = mantissa.trim_start_matches('-');
    let power = format!("10{}", superscript(exponent));
    if mantissa == "1" { format!("{sign}{power}") } else { format!("{sign}{mantissa}\u{b7}{power}") }
}

fn trim_zeros(text: &str) -> String {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text.to_string() }
}

fn superscript(number: i32) -> String {
    let digits = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    number.to_string().chars().map(|c| c.to_digit(10).map_or('⁻', |d| digits[d as usize])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round() {
        assert_eq!(nice_step((0.0, 200.0), 8.0), 20.0);
        assert_eq!(nice_step((0.0, 1.0), 5.0), 0.2);
        assert!((nice_step((-3e-7, 4e-7), 6.0) - 1e-7).abs() < 1e-20);
    }

    #[test]
    fn texts_are_short() {
        let cases = [
            (0.0, "0"),
            (0.1 + 0.2, "0.3"),
            (-40.0, "−40"),
            (1500.0, "1500"),
            (0.005, "0.005"),
            (1e-6, "10⁻⁶"),
            (-2.5e-12, "−2.5·10⁻¹²"),
            (1e5, "10⁵"),
        ];
        for (value, text) in cases {
            assert_eq!(format_tick(value), text);
        }
    }

    #[test]
    fn crowded_decades_lose_texts() {
        let texts: Vec<String> = (0..5).map(|k| tick_format(1e3, 2).format(10f64.powi(k))).collect();
        assert_eq!(texts, ["", "0.01", "", "1", ""]);
    }

    #[test]
    fn tiny_ranges_are_enlarged() {
        assert_eq!(drawing_factor(Scale::Linear, (-3.0, 5.0)), 1.0);
        assert_eq!(drawing_factor(Scale::Log, (1e-16, 1.0)), 1e16);
        assert_eq!(drawing_factor(Scale::Linear, (0.0, 2e-13)), 1e13);
    }
}
