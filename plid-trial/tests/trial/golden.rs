//! A draw without imperfections gives the bytes that it always gave: the hashes of the cases were printed by the same
//! loop before truths could be imperfect. Those of the sealed labels are of a later date, since which a label leaves
//! out what it does not know.

use std::fs;
use std::path::Path;

use plid_testbed::gap::{Channels, Experiment, PlantKind};
use plid_trial::config::{Cases, Draw};
use plid_trial::vocabulary::Outsiders;
use plid_trial::{TrialConfig, draw};
use plid_work::Silent;

/// Everything that the standard trial draws from, in few and short cases.
fn config() -> TrialConfig {
    let cases = Cases { none: 2, singles_per_effect: 1, pairs: 1, outsiders: 2, leave_one_out: 1, ..Cases::default() };
    let effects = ["clearance", "sensor-gain", "actuator-delay"].map(str::to_owned).to_vec();
    let of = |inputs: usize, outputs: usize| Channels { inputs, outputs };
    let draw = Draw {
        effects,
        plants: vec![PlantKind::Truss, PlantKind::Beam, PlantKind::Drone],
        channels: vec![of(3, 3), of(2, 2)],
        experiments: vec![Experiment::Active, Experiment::Passive],
        outputs_only: 0.2,
        misjudged: 0.3,
        length: 0.1,
        // Those that there were when the hashes were printed.
        outsiders: Outsiders::Development,
        ..Draw::default()
    };
    TrialConfig { name: "golden".to_owned(), cases, draw }
}

/// FNV-1a over the bytes of the files of a folder in the order of their names.
fn hash(folder: &Path) -> u64 {
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let bytes = files.iter().flat_map(|file| fs::read(file).unwrap());
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

#[test]
fn a_draw_without_imperfections_is_what_it_always_was() {
    let at = tempfile::tempdir().unwrap();
    draw(&config(), 5, &at.path().join("T"), &at.path().join("S"), &Silent).unwrap();
    let found: Vec<[u64; 2]> = (1..=9)
        .map(|case| ["T", "S"].map(|part| hash(&at.path().join(part).join(format!("cases/case-{case:03}")))))
        .collect();
    let before = [
        [0x8cb8_eeb0_19db_7b7b, 0x0ee6_7d22_dc7e_8df6],
        [0xe7d3_c2c2_dfdb_1a96, 0x936a_f7bc_09fe_d2df],
        [0x2a8b_5332_2547_73d6, 0x68c4_cbb7_85c9_4dde],
        [0xebe0_7945_6142_a2ff, 0x2dfd_c6a1_c19c_2b79],
        [0x0b1b_66b2_c775_8930, 0x27f5_6371_95fa_240b],
        [0x5aa6_8674_a895_940a, 0x9d5b_881f_c6bd_c368],
        [0xf1ea_ad7d_088b_2593, 0x7975_e641_5a60_4b99],
        [0xeb25_ebd8_bbd0_486e, 0xfc7d_296f_7ac2_6c59],
        [0xf99a_ca4e_e78f_a7aa, 0x2081_396a_0317_c154],
    ];
    assert_eq!(found, before, "{found:#x?}");
}
