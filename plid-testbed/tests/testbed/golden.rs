//! Codes of the ADC as they were before the list of effects existed (printed by the same loop at that commit).

use std::fs;

use plid_testbed::gap::{GapSpec, draw};
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

/// Files of gap cases as they were before cases could have other plants, channels and experiments (printed by the same
/// loop at that commit). The first one is newer: the label of a case without an effect no longer has a `config`.
#[test]
fn old_specs_give_the_cases_that_they_always_gave() {
    let (mut found, mut expected) = (Vec::new(), Vec::new());
    for (seed, text, files) in [
        (7, "perturbed = true", 0x54bd_0ee8_2bb7_bf3d),
        (8, "ports = true\n[[effects]]\nkind = \"cubic-stiffness\"\ngap = 0.1", 0xee83_5f12_3f57_ab27),
        (9, "ports = true\n[[effects]]\nkind = \"missing-mode\"\ngap = 0.05", 0x5a0a_554b_1c77_97e6),
        (
            10,
            "[[effects]]\nkind = \"actuator-lag\"\ngap = 0.05\n[[effects]]\nkind = \"sensor-crosstalk\"\ngap = 0.05",
            0xaf4f_48d1_073b_6aae,
        ),
        (
            11,
            "[[effects]]\nkind = \"actuator-delay\"\ngap = 0.05\n[[effects]]\nkind = \"x-parametric-stiffness\"\ngap = \
             0.02",
            0xd25b_2617_7a3e_d2a1,
        ),
    ] {
        let spec: GapSpec = toml::from_str(text).unwrap();
        let at = tempfile::tempdir().unwrap();
        draw(seed, &spec).unwrap().write(&at.path().join("case"), &at.path().join("label")).unwrap();
        let names = ["case/case.toml", "case/sim.json", "label/label.json", "label/test_uy.csv"].map(String::from);
        let records = (1..=6).map(|i| format!("case/r{i}.csv"));
        let bytes = names.into_iter().chain(records).flat_map(|name| fs::read(at.path().join(name)).unwrap());
        let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        found.push(hash);
        expected.push(files);
    }
    assert_eq!(found, expected, "{found:#x?}");
}
