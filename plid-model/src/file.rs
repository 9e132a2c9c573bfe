use std::fs;
use std::io;
use std::path::Path;

use plid_file::write_atomic;

use super::error::ModelError;
use super::state_space::Model;

impl Model {
    /// Reads a `model.json`. Unknown keys are ignored, and a missing `D` is zero.
    ///
    /// # Errors
    /// Returns [`ModelError::Io`], [`ModelError::Syntax`] with line and column, or [`ModelError::Key`] with the invalid
    /// key.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let place = path.display().to_string();
        let text = fs::read(path).map_err(|source| io_error(path, source))?;
        let value = serde_json::from_slice(&text).map_err(|error| ModelError::Syntax {
            place: place.clone(),
            line: error.line(),
            column: error.column(),
            message: error.to_string(),
        })?;
        Self::from_json(&value, &place)
    }

    /// Writes a `model.json` with one key per line. Equal models give equal bytes, and every number is read back
    /// exactly. The write is atomic.
    ///
    /// # Errors
    /// Returns [`ModelError::Key`] if the model is invalid (JSON has no NaN), or [`ModelError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), ModelError> {
        self.check(&path.display().to_string())?;
        write_atomic(path, self.text().as_bytes()).map_err(|source| io_error(path, source))
    }

    fn text(&self) -> String {
        let lines: Vec<String> = self.entries().into_iter().map(|(key, value)| format!("\"{key}\": {value}")).collect();
        format!("{{\n{}\n}}\n", lines.join(",\n"))
    }
}

fn io_error(path: &Path, source: io::Error) -> ModelError {
    let file = path.to_path_buf();
    ModelError::Io { file, source }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{canonical, random};
    use super::super::{Continuous, KeyProblem, Noise, OutputKind, Port};
    use super::*;
    use nalgebra::DVector;
    use proptest::prelude::*;
    use serde_json::{Value, json};

    fn full(seed: u64, indices: &[usize], m: usize) -> Model {
        let mut model = canonical(seed, indices, m);
        let (n, p) = (model.n(), model.p());
        let root = random(seed + 1, (p + m) * n, (p + m) * n);
        model.d = random(seed + 2, p, m);
        model.noise = Noise { sensor_std: Some(vec![0.1; p]), actuator_std: Some(vec![1.0 / 3.0; m]) };
        model.predictor_gain = Some(random(seed + 3, n, p));
        model.parameter_covariance = Some(&root * root.transpose());
        model.initial_state = Some(DVector::from_element(n, -1e-300));
        model.provenance = json!({"b": 0.1, "a": [1, "x", null]}).as_object().cloned();
        model.continuous = Some(Continuous { a: random(seed + 4, n, n) * 1e6, b: random(seed + 5, n, m) });
        model.ports = vec![Port {
            name: "strut".into(),
            input: Some("u1".into()),
            force: vec![1.0; n],
            displacement: vec![2.0; n],
            velocity: vec![0.7; n],
            output: Some(vec![-0.0; p]),
        }];
        model.output_kinds[0] = Some(OutputKind::Velocity);
        model
    }

    fn reread(value: &Value) -> Result<Model, ModelError> {
        Model::from_json(value, "m.json")
    }

    fn key_error(value: &Value) -> (String, KeyProblem) {
        match reread(value) {
            Err(ModelError::Key { place, key, problem }) => {
                assert_eq!(place, "m.json");
                (key, problem)
            }
            other => panic!("{other:?}"),
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn files_read_back_exactly(
            seed in 0_u64..1 << 40,
            indices in prop::collection::vec(1_usize..4, 1..4),
            m in 1_usize..4,
            scale in prop::num::f64::NORMAL,
        ) {
            let directory = tempfile::tempdir().unwrap();
            let path = directory.path().join("model.json");
            let mut model = full(seed, &indices, m);
            model.b[(0, 0)] = scale;
            model.write(&path).unwrap();
            prop_assert_eq!(&Model::read(&path).unwrap(), &model);
            let bytes = fs::read(&path).unwrap();
            model.write(&path).unwrap();
            prop_assert_eq!(bytes, fs::read(&path).unwrap());
            prop_assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
        }
    }

    #[test]
    fn what_is_not_needed_may_be_left_out() {
        let value = json!({"format": "state-space", "sample_rate_hz": 100, "inputs": ["f"], "outputs": ["x"],
            "A": [[0.5]], "B": [[1]], "C": [[2]], "unheard_of": {"A": 3}});
        let model = reread(&value).unwrap();
        assert_eq!(model.d, random(0, 1, 1) * 0.0);
        assert_eq!(model.c[(0, 0)], 2.0);
        assert_eq!(model.noise, Noise::default());
        assert!(model.to_json().get("unheard_of").is_none());
    }

    #[test]
    fn each_fault_names_its_key() {
        let good = full(1, &[2, 1], 2).to_json();
        let with = |key: &str, value: Value| {
            let mut bad = good.clone();
            bad[key] = value;
            key_error(&bad)
        };
        let shape = |expected, found| KeyProblem::Shape { expected, found };
        assert_eq!(with("A", Value::Null), ("A".into(), KeyProblem::Missing));
        assert_eq!(with("A", json!([])).0, "A");
        // The balancing would not terminate.
        assert_eq!(with("A", json!([[0, 1, 0], [0, 1e300, 1], [-1, 0, 0]])).0, "A");
        assert_eq!(with("B", json!([[1, 2]])), ("B".into(), shape((3, 2), (1, 2))));
        assert_eq!(with("B", json!([[1, 2], [1], [1, 2]])), ("B[1]".into(), shape((1, 2), (1, 1))));
        assert_eq!(with("C", json!([[1, 2, null], [1, 2, 3]])).0, "C[0][2]");
        assert_eq!(with("D", json!([[1, 2]])).0, "D");
        assert_eq!(with("predictor_gain", json!([[1]])).0, "predictor_gain");
        assert_eq!(with("initial_state", json!([1])).0, "initial_state");
        assert_eq!(with("parameter_covariance", json!([[1]])).0, "parameter_covariance");
        let indices = "observability_indices";
        assert_eq!(with(indices, json!([1, 1])).0, indices);
        assert_eq!(with(indices, json!([3, 0])).0, indices);
        assert_eq!(with(indices, json!([1.5, 1.5])).0, indices);
        assert_eq!(with(indices, json!([u64::MAX, 1])).0, indices);
        assert_eq!(with("sample_rate_hz", json!(0)).0, "sample_rate_hz");
        assert_eq!(with("sample_rate_hz", json!(1e-320)).0, "sample_rate_hz");
        assert_eq!(with("inputs", json!(["a", "a"])).0, "inputs");
        assert_eq!(with("outputs", json!(["a", 3])).0, "outputs[1]");
        assert_eq!(with("format", json!("arx")).0, "format");
        assert_eq!(with("provenance", json!(3)).0, "provenance");
        assert_eq!(with("noise", json!({"sensor_std": [1, -1]})).0, "noise.sensor_std[1]");
        assert_eq!(with("continuous", json!({"A": [[1]]})).0, "continuous.B");
        let port =
            json!({"name": "p", "input": "u9", "force": [1, 2, 3], "displacement": [1, 2, 3], "velocity": [1, 2, 3]});
        assert_eq!(with("ports", json!([port])).0, "ports[0].input");
        assert_eq!(with("output_kinds", json!({"y9": "velocity"})).0, "output_kinds.y9");
        assert_eq!(with("output_kinds", json!({"y1": "speed"})).0, "output_kinds.y1");
    }

    #[test]
    fn faults_of_the_file_are_told_apart() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("model.json");
        assert!(matches!(Model::read(&path), Err(ModelError::Io { file, .. }) if file == path));
        for text in ["", "{\n\"A\": [[NaN]]}", "{\n\"A\": [[1e999]]}"] {
            fs::write(&path, text).unwrap();
            let error = Model::read(&path).unwrap_err();
            let wanted = usize::from(!text.is_empty()) + 1;
            assert!(matches!(error, ModelError::Syntax { line, .. } if line == wanted), "{error}");
        }
        fs::write(&path, "[1]").unwrap();
        assert!(matches!(Model::read(&path), Err(ModelError::Key { .. })));
    }

    #[test]
    fn a_model_that_is_not_finite_is_not_written() {
        let directory = tempfile::tempdir().unwrap();
        let mut model = canonical(2, &[2], 1);
        model.a[(1, 0)] = f64::NAN;
        let error = model.write(&directory.path().join("model.json"));
        assert!(matches!(error, Err(ModelError::Key { key, .. }) if key == "A[1][0]"));
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
    }
}
