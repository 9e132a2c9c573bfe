//! Codes of the ADC as they were before the list of effects existed (printed by the same loop at that commit).

use plid_testbed::{TrussConfig, simulate};

/// FNV-1a over the bits of every value.
fn hash(values: impl Iterator<Item = f64>) -> u64 {
    values.fold(0xcbf2_9ce4_8422_2325, |h, v| (h ^ v.to_bits()).wrapping_mul(0x0100_0000_01b3))
}

#[test]
fn old_configs_give_the_codes_that_they_always_gave() {
    for (text, commands, outputs) in [
        ("", 0x248b_9296_619b_a2b7, 0xb5d0_911b_8cf1_d2bf),
        ("repeats = 2\n[input.multisine]", 0x2242_e92d_0fe8_fa24, 0x29a9_be60_3360_f69d),
        ("sample_rate_hz = 1200.0\n[input.chirp]", 0xb2ce_a0b3_080d_1026, 0xfed5_401b_3009_8227),
        (
            "[effects]\nstiffness_drift_per_s = 1e-3\n[effects.cubic_joint]\ninput = 2\nstiffness_per_v2 = 1e-4",
            0x248b_9296_619b_a2b7,
            0xf13b_0006_748f_069a,
        ),
    ] {
        let config: TrussConfig = toml::from_str(&format!("duration_s = 1.0\n{text}")).unwrap();
        let run = simulate(&config).unwrap();
        assert_eq!(hash(run.commands.iter().copied()), commands, "{text}");
        assert_eq!(hash(run.outputs.iter().flatten().copied()), outputs, "{text}");
    }
}
