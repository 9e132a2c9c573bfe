//! An FMU against the closed form, and FMUs that fail. The tests need a C compiler and are skipped, visibly, without.

mod common;

use std::path::Path;

use common::{built, built_with, description, pack};
use plid_fmu::{ChosenParameter, Fmu, FmuError, Options};
use plid_simulator::{Checked, Motion, OutputKind, Simulator, check};

const RATE: f64 = 100.0;

/// At a sample rate, with parameters and the oscillator's port.
fn options(parameters: &[&str], port: bool) -> Options {
    let ports = if port { vec!["spring=push,position,velocity".parse().unwrap()] } else { Vec::new() };
    let parameters = parameters.iter().map(|name| ChosenParameter::new(*name)).collect();
    Options { rate_hz: Some(RATE), parameters, ports, ..Options::default() }
}

/// Runs a test with the oscillator of both versions of FMI.
fn with_both(test: impl Fn(&Path)) {
    let folder = tempfile::tempdir().unwrap();
    for version in [2, 3] {
        let Some(file) = built(folder.path(), version) else { return };
        test(&file);
    }
}

/// Position of the oscillator after a step of force at rest.
fn closed_form(force: f64, [mass, stiffness, damping]: [f64; 3], t: f64) -> f64 {
    let sigma = damping / (2.0 * mass);
    let omega = (stiffness / mass - sigma * sigma).sqrt();
    let decay = (-sigma * t).exp() * ((omega * t).cos() + sigma / omega * (omega * t).sin());
    force / stiffness * (1.0 - decay)
}

#[test]
fn a_step_follows_the_closed_form() {
    with_both(|file| {
        let mut fmu = Fmu::open(file, &options(&["mass", "stiffness", "damping"], true)).unwrap();
        let mut checked = Checked::new(&mut fmu).unwrap();
        let samples = 100;
        for parameters in [[2.0, 800.0, 4.0], [1.5, 700.0, 5.0], [2.0, 800.0, 4.0]] {
            let y = checked.run(&parameters, &[vec![3.0; samples]]).unwrap();
            let none = vec![vec![3.0; 10 * samples]];
            let pushed = checked.run_with(&parameters, &none, |_, _, forces| forces[0] = 0.5).unwrap();
            for k in 0..samples {
                let expected = |force: f64| closed_form(force, parameters, k as f64 / RATE);
                assert!((y[0][k] - expected(3.0)).abs() < 1e-11, "{k}");
                assert!((pushed[0][k] - expected(3.5)).abs() < 1e-11, "{k}");
                // The outputs are those at the start of a step, after the inputs are set.
                assert_eq!(y[1][k], 30.0);
            }
        }
    });
}

#[test]
fn the_description_tells_what_the_fmu_tells() {
    with_both(|file| {
        let fmu = Fmu::open(file, &options(&["mass", "stiffness"], true)).unwrap();
        let description = fmu.description();
        assert_eq!((description.name.as_str(), description.steps_per_sample), ("oscillator", 10));
        let names: Vec<&str> = description.inputs.iter().map(|input| input.name.as_str()).collect();
        assert_eq!((names, description.inputs[0].unit.as_deref()), (vec!["force"], Some("N")));
        let kinds: Vec<_> = description.outputs.iter().map(|output| (output.name.as_str(), output.kind)).collect();
        assert_eq!(kinds, [("position", Some(OutputKind::Position)), ("signal", None)]);
        let port = &description.ports[0];
        assert_eq!((port.input.as_ref(), port.displacement_unit.as_deref()), (None, Some("m")));
        let [mass, stiffness] = &description.parameters[..] else { panic!() };
        assert_eq!((mass.value, mass.lower, mass.unit.as_deref()), (2.0, Some(0.01), Some("kg")));
        assert_eq!((stiffness.value, stiffness.lower, stiffness.upper), (800.0, Some(0.0), None));
        // A port at an input adds its force there; without a port a sample is a step.
        let mut both = options(&[], true);
        both.inputs = Some(vec!["push".into()]);
        both.outputs = Some(vec!["position".into()]);
        let both = Fmu::open(file, &both).unwrap();
        assert_eq!(both.description().ports[0].input.as_deref(), Some("push"));
        assert_eq!(both.description().outputs.len(), 1);
        let bare = Options { rate_hz: None, ..options(&[], false) };
        let bare = Fmu::open(file, &bare).unwrap();
        let (rate, steps) = (bare.description().rate_hz, bare.description().steps_per_sample);
        assert_eq!((rate, steps, bare.description().inputs.len()), (1000.0, 1, 2));
    });
}

#[test]
fn the_checker_passes_the_fmu() {
    with_both(|file| {
        let mut at_input = options(&["mass", "stiffness", "damping"], true);
        at_input.inputs = Some(vec!["push".into()]);
        for options in [at_input, options(&["mass"], true), options(&["mass"], false)] {
            let mut fmu = Fmu::open(file, &options).unwrap();
            let findings = check(&mut fmu, 1.0).unwrap();
            assert!(findings.iter().all(|finding| finding.holds), "{findings:#?}");
        }
    });
}

/// States are kept by an FMU that offers it, and lost with the next start. One that does not says so.
#[test]
fn a_state_is_kept_until_the_next_start() {
    with_both(|file| {
        let mut fmu = Fmu::open(file, &options(&["mass"], true)).unwrap();
        let (mut y, mut motions) = ([0.0; 2], [Motion::default()]);
        let mut follow = |fmu: &mut Fmu| -> Vec<Motion> {
            let one = |_| fmu.step(&[1.0], &[0.5], &mut y, &mut motions).map(|()| motions[0]).unwrap();
            (0..20).map(one).collect()
        };
        for _ in 0..3 {
            fmu.start(&[2.0]).unwrap();
            assert!(fmu.restore(3).unwrap_err().to_string().contains("slot 3 holds no state"));
            let before = follow(&mut fmu);
            fmu.save(3).unwrap();
            let after = follow(&mut fmu);
            fmu.save(4).unwrap();
            assert_eq!(fmu.restore(3).unwrap(), before[19..]);
            assert_eq!(follow(&mut fmu), after);
            assert_eq!(fmu.restore(4).unwrap(), after[19..]);
        }
    });
    let folder = tempfile::tempdir().unwrap();
    let Some(file) = built_with(folder.path(), 2, &description(2).replace("canGetAndSetFMUstate=\"true\"", "")) else {
        return;
    };
    let mut fmu = Fmu::open(&file, &options(&[], true)).unwrap();
    fmu.start(&[]).unwrap();
    assert!(fmu.save(0).unwrap_err().to_string().contains("cannot store its state"));
}

/// Instances do not know of each other.
#[test]
fn another_instance_is_independent() {
    with_both(|file| {
        let mut fmu = Fmu::open(file, &options(&["mass"], false)).unwrap();
        let mut another = fmu.another().unwrap().unwrap();
        let u = [(0..200).map(|k| f64::from(k % 7) - 3.0).collect::<Vec<f64>>(), vec![0.0; 200]];
        let expected = [2.0, 1.5].map(|mass| fmu.run(&[mass], &u).unwrap());
        let both = std::thread::scope(|scope| {
            let one = scope.spawn(|| fmu.run(&[2.0], &u).unwrap());
            [another.run(&[1.5], &u).unwrap(), one.join().unwrap()]
        });
        assert_eq!([&both[1], &both[0]], [&expected[0], &expected[1]]);
        drop(fmu);
        assert_eq!(another.run(&[2.0], &u).unwrap(), expected[0]);
    });
    let folder = tempfile::tempdir().unwrap();
    let once = "canBeInstantiatedOnlyOncePerProcess=\"true\" canGetAndSet";
    let Some(file) = built_with(folder.path(), 2, &description(2).replace("canGetAndSet", once)) else { return };
    assert!(Fmu::open(&file, &options(&[], false)).unwrap().another().unwrap().is_none());
}

/// Each run begins anew, also where the FMU's own reset fails or does nothing.
#[test]
fn a_reset_that_fails_does_no_harm() {
    with_both(|file| {
        for fault in [0.0, 7.0, 8.0] {
            let mut fmu = Fmu::open(file, &options(&["fault", "start"], true)).unwrap();
            let u = [(0..50).map(|k| f64::from(k % 7) - 3.0).collect::<Vec<f64>>()];
            let first = fmu.run(&[fault, 0.0], &u).unwrap();
            for _ in 0..3 {
                assert_eq!(fmu.run(&[fault, 0.0], &u).unwrap(), first, "fault {fault}");
                assert_ne!(fmu.run(&[fault, 0.1], &u).unwrap(), first);
            }
            // Displacements count from the start.
            assert_eq!(fmu.start(&[fault, 0.1]).unwrap()[0].displacement, 0.0);
        }
    });
}

/// A failure names the file, the function or the variable, the time, and the FMU's own messages. The next run succeeds.
#[test]
fn a_failing_step_is_named() {
    with_both(|file| {
        let mut fmu = Fmu::open(file, &options(&["fault"], false)).unwrap();
        let u = [vec![1.0; 20], vec![0.0; 20]];
        let sound = fmu.run(&[0.0], &u).unwrap();
        let mut failure = |fault: f64| {
            let message = fmu.run(&[fault], &u).unwrap_err().to_string();
            assert!(message.contains("oscillator") && message.contains(".fmu"), "{message}");
            assert_eq!(fmu.run(&[0.0], &u).unwrap(), sound, "after {message}");
            message
        };
        let unsound = failure(1.0);
        assert!(unsound.contains("variable \"position\" is NaN at 0.11 s"), "{unsound}");
        for (fault, status) in [(2.0, "error"), (3.0, "discard"), (6.0, "fatal")] {
            let failed = failure(fault);
            assert!(failed.contains(&format!("DoStep returned \"{status}\" at 0.1 s")), "{failed}");
            assert!(failed.contains(&format!("{status}: the spring broke at 0.10 s, 1 of 2")), "{failed}");
        }
    });
}

#[test]
fn a_wrong_name_is_answered_with_those_that_exist() {
    with_both(|file| {
        let refused = |change: &dyn Fn(&mut Options)| {
            let mut options = options(&["mass"], true);
            change(&mut options);
            let error = Fmu::open(file, &options).err().unwrap();
            assert!(error.to_string().contains(".fmu"), "{error}");
            error.to_string()
        };
        let meant = refused(&|options| options.parameters[0].name = "stifness".into());
        assert!(meant.contains("variable \"stifness\"") && meant.contains("did you mean \"stiffness\"?"), "{meant}");
        assert!(meant.contains("mass, stiffness, damping, start, fault"), "{meant}");
        let output = refused(&|options| options.parameters[0].name = "position".into());
        assert!(output.contains("causality \"output\"") && output.contains("real parameter"), "{output}");
        let integer = refused(&|options| options.parameters[0].name = "coils".into());
        assert!(integer.contains("it is Int"), "{integer}");
        let force = refused(&|options| options.ports[0].force = "position".into());
        assert!(force.contains("the force of a port would be force, push"), "{force}");
        let moves = refused(&|options| options.ports[0].velocity = "mass".into());
        assert!(moves.contains("would be position, velocity, signal"), "{moves}");
        let input = refused(&|options| options.inputs = Some(vec!["frce".into()]));
        assert!(input.contains("did you mean \"force\"?"), "{input}");
        let steps = refused(&|options| options.steps_per_sample = Some(0));
        assert!(steps.contains("at least one step"), "{steps}");
        let rate = refused(&|options| options.rate_hz = Some(-1.0));
        assert!(rate.contains("-1 Hz is not positive"), "{rate}");
    });
}

#[test]
fn files_that_are_no_such_fmu_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let open = |name: &str| Fmu::open(&at(name), &options(&[], false)).err().unwrap();
    assert!(matches!(open("missing.fmu"), FmuError::Io { .. }));
    std::fs::write(at("text.fmu"), "no archive").unwrap();
    assert!(matches!(open("text.fmu"), FmuError::Archive { .. }));
    pack(&at("empty.fmu"), &[("readme.txt", b"")]);
    let empty = open("empty.fmu").to_string();
    assert!(empty.contains("empty.fmu: modelDescription.xml"), "{empty}");
    let text = description(2);
    let xml = |name: &str, text: &str| {
        pack(&at(name), &[("modelDescription.xml", text.as_bytes()), ("binaries/win9x/oscillator.dll", b"")]);
        open(name)
    };
    let one = xml("one.fmu", &text.replace("\"2.0\"", "\"1.0\""));
    assert!(matches!(&one, FmuError::Version { version, .. } if version == "1.0"), "{one}");
    let exchange = xml("exchange.fmu", &text.replace("<CoSimulation", "<ModelExchange")).to_string();
    assert!(exchange.contains("exchange.fmu: it is for model exchange only"), "{exchange}");
    let platform = xml("platform.fmu", &text).to_string();
    assert!(platform.contains("it has no binaries/") && platform.contains("binaries/win9x"), "{platform}");
    let half = std::fs::read(at("platform.fmu")).unwrap();
    std::fs::write(at("half.fmu"), &half[..half.len() / 2]).unwrap();
    assert!(matches!(open("half.fmu"), FmuError::Archive { .. }));
    pack(
        &at("noise.fmu"),
        &[
            ("modelDescription.xml", text.as_bytes()),
            (&format!("binaries/{}/oscillator{}", common::platform(2), std::env::consts::DLL_SUFFIX), b"no library"),
        ],
    );
    let noise = open("noise.fmu").to_string();
    assert!(noise.contains("cannot be loaded") && noise.contains("oscillator"), "{noise}");
}

/// An FMU that refuses to be created says why.
#[test]
fn a_refused_instance_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for version in [2, 3] {
        let text = description(version).replace("{oscillator}", "{another}");
        let Some(file) = built_with(folder.path(), version, &text) else { return };
        let message = Fmu::open(&file, &options(&[], false)).err().unwrap().to_string();
        assert!(message.contains("instantiation") && message.contains("no GUID of this FMU"), "{message}");
    }
}

/// A fixed step of the FMU is named where another one failed.
#[test]
fn a_step_of_another_size_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let text = description(2).replace("canHandleVariableCommunicationStepSize=\"true\"", "");
    let Some(file) = built_with(folder.path(), 2, &text) else { return };
    let mut fmu = Fmu::open(&file, &options(&["fault"], false)).unwrap();
    let message = fmu.run(&[2.0], &[vec![1.0; 20], vec![0.0; 20]]).unwrap_err().to_string();
    assert!(message.contains("its steps are fixed at 0.001 s, but 0.01 s were requested"), "{message}");
}

/// What a killed process has unpacked is removed when the next FMU is opened, and what a living one uses is not.
#[test]
fn unpacked_files_of_killed_processes_are_removed() {
    let all = std::env::temp_dir();
    let left = all.join(format!(".plid-fmu.killed-{}.plid-tmp", std::process::id()));
    with_both(|file| {
        let open = || Fmu::open(file, &options(&["mass"], false)).unwrap();
        let living = plid_file::Scratch::new(&all, "plid-fmu").unwrap();
        std::fs::create_dir(&left).unwrap();
        let mut first = open();
        assert!(!left.exists() && living.path().exists());
        // A second one leaves the first one's files, too, where resources may still be read.
        drop(open());
        assert!(first.run(&[2.0], &[vec![1.0; 10]]).is_ok());
    });
}
