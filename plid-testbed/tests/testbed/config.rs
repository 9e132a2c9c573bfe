use plid_testbed::{Chirp, CubicJoint, InputConfig, Multisine, TestbedError, TrussConfig, WhiteNoise, simulate, truss};

#[test]
fn the_default_is_the_papers_experiment() {
    let config: TrussConfig = toml::from_str("").unwrap();
    assert_eq!(config, TrussConfig::default());
    assert_eq!((config.sample_rate_hz, config.duration_s, config.samples().unwrap()), (1600.0, 13.0, 20_800));
}

#[test]
fn a_config_in_toml_says_what_it_means() {
    let text = r#"
        duration_s = 4.0
        repeats = 3
        seed = 9
        [input.multisine]
        level_rms_v = [1.0, 0.5, 0.0]
        period_samples = 2003
        [noise]
        ambient_rms_v = 0.0
        [converters]
        range_v = inf
        [effects]
        stiffness_drift_per_s = -1e-3
        [effects.cubic_joint]
        input = 2
        stiffness_per_v2 = 0.01
    "#;
    let config: TrussConfig = toml::from_str(text).unwrap();
    assert_eq!(config.repeats, 3);
    let InputConfig::Multisine(multisine) = &config.input else { panic!("{:?}", config.input) };
    assert_eq!(multisine.period_samples, 2003);
    assert_eq!(multisine.band_hz, Multisine::default().band_hz);
    assert_eq!(config.noise.sensor_rms_v, 0.005);
    assert_eq!(config.effects.cubic_joint, Some(CubicJoint { input: 2, stiffness_per_v2: 0.01 }));
    config.check().unwrap();
    let again: TrussConfig = toml::from_str(&toml::to_string(&config).unwrap()).unwrap();
    assert_eq!(again, config);
    let rest: TrussConfig = toml::from_str("input = \"zero\"").unwrap();
    assert_eq!(rest.input, InputConfig::Zero);
}

#[test]
fn an_unknown_key_is_an_error_at_every_depth() {
    for text in [
        "rate_hz = 1.0",
        "[noise]\nsensor_v = 1.0",
        "[converters]\nbits = 12",
        "[input.white-noise]\nlevel = 1.0",
        "[input.chirp]\nfrom_hz = 1.0",
        "[structure]\ntubes = 6",
        "[effects.cubic_joint]\ninput = 1\nstiffness_per_v2 = 1.0\nk = 2.0",
        "input = \"pink\"",
    ] {
        assert!(toml::from_str::<TrussConfig>(text).is_err(), "{text}");
    }
}

/// Each wrong value gives an error that names its key.
#[test]
fn wrong_values_are_named() {
    type Change = fn(&mut TrussConfig);
    let cases: [(&str, Change); 29] = [
        ("`sample_rate_hz`", |c| c.sample_rate_hz = 0.0),
        ("`sample_rate_hz`", |c| c.sample_rate_hz = f64::NAN),
        ("`sample_rate_hz`", |c| c.sample_rate_hz = f64::INFINITY),
        ("`sample_rate_hz`", |c| c.sample_rate_hz = 0.5),
        ("`sample_rate_hz`", |c| c.sample_rate_hz = 2e6),
        ("`duration_s`", |c| c.duration_s = -1.0),
        ("`duration_s`", |c| c.duration_s = 1e-9),
        ("`duration_s`", |c| c.duration_s = 1e12),
        ("`repeats`", |c| c.repeats = 0),
        ("`noise.sensor_rms_v`", |c| c.noise.sensor_rms_v = -1.0),
        ("`noise.amplifier_rms_v`", |c| c.noise.amplifier_rms_v = f64::NAN),
        ("`noise.ambient_rms_v`", |c| c.noise.ambient_rms_v = f64::INFINITY),
        ("`converters.step_v`", |c| c.converters.step_v = -0.1),
        ("`converters.range_v`", |c| c.converters.range_v = 0.0),
        ("`structure.strut_modes_per_tube`", |c| c.structure.strut_modes_per_tube = 3),
        ("`structure.strut_modes_per_tube`", |c| c.structure.strut_modes_per_tube = 0),
        ("`effects.steps_per_sample`", |c| c.effects.steps_per_sample = 0),
        ("`effects.stiffness_drift_per_s`", |c| c.effects.stiffness_drift_per_s = f64::NAN),
        ("`effects.stiffness_drift_per_s`", |c| c.effects.stiffness_drift_per_s = -0.1),
        ("`effects.cubic_joint.input`", |c| {
            c.effects.cubic_joint = Some(CubicJoint { input: 4, stiffness_per_v2: 0.0 });
        }),
        ("`effects.cubic_joint.stiffness_per_v2`", |c| {
            c.effects.cubic_joint = Some(CubicJoint { input: 1, stiffness_per_v2: f64::NAN });
        }),
        ("`input.white-noise.level_rms_v`", |c| {
            c.input =
                InputConfig::WhiteNoise(WhiteNoise { level_rms_v: [1.0, f64::NAN, 1.0], ..WhiteNoise::default() });
        }),
        ("`input.white-noise.cutoff_hz`", |c| {
            c.input = InputConfig::WhiteNoise(WhiteNoise { cutoff_hz: 800.0, ..WhiteNoise::default() });
        }),
        ("`input.white-noise.cutoff_hz`", |c| {
            c.input = InputConfig::WhiteNoise(WhiteNoise { cutoff_hz: 0.0, ..WhiteNoise::default() });
        }),
        ("`input.multisine.period_samples`", |c| {
            c.input = InputConfig::Multisine(Multisine { period_samples: 0, ..Multisine::default() });
        }),
        ("`input.multisine.band_hz`", |c| {
            c.input = InputConfig::Multisine(Multisine { band_hz: [100.0, 900.0], ..Multisine::default() });
        }),
        ("`input.multisine.band_hz`", |c| {
            c.input = InputConfig::Multisine(Multisine { band_hz: [100.0, 50.0], ..Multisine::default() });
        }),
        ("`input.chirp.end_hz`", |c| c.input = InputConfig::Chirp(Chirp { end_hz: 1000.0, ..Chirp::default() })),
        ("`input.chirp.level_rms_v`", |c| {
            c.input = InputConfig::Chirp(Chirp { level_rms_v: [-1.0, 0.0, 0.0], ..Chirp::default() });
        }),
    ];
    for (key, change) in cases {
        let mut config = TrussConfig::default();
        change(&mut config);
        let error = simulate(&config).expect_err(key).to_string();
        assert!(error.contains(key), "{error}");
    }
}

#[test]
fn the_plant_alone_is_checked_too() {
    let config = TrussConfig { sample_rate_hz: 0.0, ..TrussConfig::default() };
    let error = truss(&config).unwrap_err();
    assert_eq!(error, TestbedError::NotPositive { key: "sample_rate_hz", value: 0.0 });
}
