use nalgebra::{DMatrix, DVector};
use serde_json::{Map, Value, json};

use super::error::{KeyProblem, ModelError};
use super::state_space::{Continuous, Model, Noise, OutputKind, Port, at};

/// The only supported value of the key `format`.
const FORMAT: &str = "state-space";

impl Model {
    /// Reads a model from a JSON value. Unknown keys are ignored, and a missing `D` is zero. `place` is the name of the
    /// value in an error message, usually the file.
    ///
    /// # Errors
    /// Returns [`ModelError::Key`] with the first invalid key.
    pub fn from_json(value: &Value, place: &str) -> Result<Self, ModelError> {
        let keys = Keys::of(value, place, "")?;
        if keys.need("format")?.as_str() != Some(FORMAT) {
            return Err(keys.kind("format", "\"state-space\""));
        }
        let b = keys.matrix(keys.need("B")?, "B")?;
        let c = keys.matrix(keys.need("C")?, "C")?;
        let d = match keys.get("D") {
            Some(value) => keys.matrix(value, "D")?,
            None => DMatrix::zeros(c.nrows(), b.ncols()),
        };
        let outputs = keys.names("outputs")?;
        let output_kinds = keys.output_kinds(&outputs)?;
        let model = Self {
            sample_rate_hz: keys.number(keys.need("sample_rate_hz")?, "sample_rate_hz")?,
            inputs: keys.names("inputs")?,
            outputs,
            a: keys.matrix(keys.need("A")?, "A")?,
            b,
            c,
            d,
            noise: keys.noise()?,
            predictor_gain: keys.optional_matrix("predictor_gain")?,
            observability_indices: keys.indices()?,
            parameter_covariance: keys.optional_matrix("parameter_covariance")?,
            initial_state: keys.optional_list("initial_state")?.map(DVector::from_vec),
            provenance: keys.provenance()?,
            continuous: keys.continuous()?,
            ports: keys.ports()?,
            output_kinds,
        };
        model.check(place)?;
        Ok(model)
    }

    /// Returns the model as a JSON value, the inverse of [`Model::from_json`].
    pub fn to_json(&self) -> Value {
        let entries = self.entries();
        Value::Object(entries.into_iter().map(|(k, v)| (k.into(), v)).collect())
    }

    /// Returns keys and values in the order of the file, without the keys that have no value.
    pub(super) fn entries(&self) -> Vec<(&'static str, Value)> {
        let mut entries = vec![
            ("format", json!(FORMAT)),
            ("sample_rate_hz", json!(self.sample_rate_hz)),
            ("inputs", json!(self.inputs)),
            ("outputs", json!(self.outputs)),
            ("A", rows(&self.a)),
            ("B", rows(&self.b)),
            ("C", rows(&self.c)),
            ("D", rows(&self.d)),
        ];
        let mut noise = Map::new();
        if let Some(sensor) = &self.noise.sensor_std {
            noise.insert("sensor_std".into(), json!(sensor));
        }
        if let Some(actuator) = &self.noise.actuator_std {
            noise.insert("actuator_std".into(), json!(actuator));
        }
        entries.push(("noise", Value::Object(noise)));
        let optional = [
            ("predictor_gain", self.predictor_gain.as_ref().map(rows)),
            ("observability_indices", self.observability_indices.as_ref().map(|x| json!(x))),
            ("parameter_covariance", self.parameter_covariance.as_ref().map(rows)),
            ("initial_state", self.initial_state.as_ref().map(|x| json!(x.as_slice()))),
            ("provenance", self.provenance.clone().map(Value::Object)),
            ("continuous", self.continuous.as_ref().map(|x| json!({"A": rows(&x.a), "B": rows(&x.b)}))),
            ("ports", (!self.ports.is_empty()).then(|| self.ports.iter().map(port_json).collect())),
            ("output_kinds", self.declared_kinds()),
        ];
        entries.extend(optional.into_iter().filter_map(|(k, v)| Some((k, v?))));
        entries
    }

    /// Returns the declared kinds by output, if there are any.
    fn declared_kinds(&self) -> Option<Value> {
        let declared = self.outputs.iter().zip(&self.output_kinds);
        let kinds: Map<String, Value> =
            declared.filter_map(|(output, kind)| Some((output.clone(), json!((*kind)?.name())))).collect();
        (!kinds.is_empty()).then_some(Value::Object(kinds))
    }
}

fn rows(matrix: &DMatrix<f64>) -> Value {
    matrix.row_iter().map(|row| row.iter().copied().collect::<Value>()).collect()
}

fn port_json(port: &Port) -> Value {
    let mut value = json!({
        "name": port.name,
        "force": port.force,
        "displacement": port.displacement,
        "velocity": port.velocity,
    });
    if let Some(input) = &port.input {
        value["input"] = json!(input);
    }
    if let Some(output) = &port.output {
        value["output"] = json!(output);
    }
    value
}

/// A JSON object and its location for error messages.
struct Keys<'a> {
    object: &'a Map<String, Value>,
    place: &'a str,
    /// The path of the object, such as `ports[0].`.
    prefix: String,
}

impl<'a> Keys<'a> {
    fn of(value: &'a Value, place: &'a str, key: &str) -> Result<Self, ModelError> {
        let kind = KeyProblem::Kind { expected: "an object" };
        let name = if key.is_empty() { "(all)" } else { key };
        let object = value.as_object().ok_or_else(|| at(place, name, kind))?;
        let prefix = if key.is_empty() { String::new() } else { format!("{key}.") };
        Ok(Self { object, place, prefix })
    }

    fn inner(&self, value: &'a Value, key: &str) -> Result<Keys<'a>, ModelError> {
        Keys::of(value, self.place, &format!("{}{key}", self.prefix))
    }

    fn kind(&self, key: &str, expected: &'static str) -> ModelError {
        let key = format!("{}{key}", self.prefix);
        at(self.place, key, KeyProblem::Kind { expected })
    }

    /// Returns the value of a key; null counts as absent.
    fn get(&self, key: &str) -> Option<&'a Value> {
        self.object.get(key).filter(|value| !value.is_null())
    }

    fn need(&self, key: &str) -> Result<&'a Value, ModelError> {
        let name = || format!("{}{key}", self.prefix);
        self.get(key).ok_or_else(|| at(self.place, name(), KeyProblem::Missing))
    }

    fn number(&self, value: &Value, key: &str) -> Result<f64, ModelError> {
        value.as_f64().ok_or_else(|| self.kind(key, "a number"))
    }

    fn array(&self, value: &'a Value, key: &str) -> Result<&'a Vec<Value>, ModelError> {
        value.as_array().ok_or_else(|| self.kind(key, "a list"))
    }

    fn list(&self, value: &'a Value, key: &str) -> Result<Vec<f64>, ModelError> {
        let items = self.array(value, key)?.iter().enumerate();
        items.map(|(i, x)| self.number(x, &format!("{key}[{i}]"))).collect()
    }

    fn matrix(&self, value: &'a Value, key: &str) -> Result<DMatrix<f64>, ModelError> {
        let lists = self.array(value, key)?.iter().enumerate();
        let rows: Vec<Vec<f64>> =
            lists.map(|(i, row)| self.list(row, &format!("{key}[{i}]"))).collect::<Result<_, _>>()?;
        let columns = rows.first().map_or(0, Vec::len);
        for (i, row) in rows.iter().enumerate() {
            if row.len() != columns {
                let (expected, found) = ((1, columns), (1, row.len()));
                let key = format!("{}{key}[{i}]", self.prefix);
                let problem = KeyProblem::Shape { expected, found };
                return Err(at(self.place, key, problem));
            }
        }
        let data = rows.concat();
        Ok(DMatrix::from_row_slice(rows.len(), columns, &data))
    }

    fn optional_matrix(&self, key: &str) -> Result<Option<DMatrix<f64>>, ModelError> {
        self.get(key).map(|x| self.matrix(x, key)).transpose()
    }

    fn optional_list(&self, key: &str) -> Result<Option<Vec<f64>>, ModelError> {
        self.get(key).map(|x| self.list(x, key)).transpose()
    }

    fn string(&self, value: &Value, key: &str) -> Result<String, ModelError> {
        let text = value.as_str().map(str::to_string);
        text.ok_or_else(|| self.kind(key, "a name"))
    }

    fn names(&self, key: &str) -> Result<Vec<String>, ModelError> {
        let items = self.array(self.need(key)?, key)?.iter().enumerate();
        items.map(|(i, x)| self.string(x, &format!("{key}[{i}]"))).collect()
    }

    fn noise(&self) -> Result<Noise, ModelError> {
        let Some(value) = self.get("noise") else {
            return Ok(Noise::default());
        };
        let keys = self.inner(value, "noise")?;
        Ok(Noise { sensor_std: keys.optional_list("sensor_std")?, actuator_std: keys.optional_list("actuator_std")? })
    }

    fn indices(&self) -> Result<Option<Vec<usize>>, ModelError> {
        let key = "observability_indices";
        let Some(value) = self.get(key) else {
            return Ok(None);
        };
        let index = |x: &Value| x.as_u64().and_then(|x| usize::try_from(x).ok());
        let indices: Option<Vec<usize>> = self.array(value, key)?.iter().map(index).collect();
        let indices = indices.ok_or_else(|| self.kind(key, "a list of integers"))?;
        Ok(Some(indices))
    }

    fn provenance(&self) -> Result<Option<Map<String, Value>>, ModelError> {
        let key = "provenance";
        let object = |x: &Value| x.as_object().cloned();
        self.get(key).map(|x| object(x).ok_or_else(|| self.kind(key, "an object"))).transpose()
    }

    fn continuous(&self) -> Result<Option<Continuous>, ModelError> {
        let Some(value) = self.get("continuous") else {
            return Ok(None);
        };
        let keys = self.inner(value, "continuous")?;
        Ok(Some(Continuous { a: keys.matrix(keys.need("A")?, "A")?, b: keys.matrix(keys.need("B")?, "B")? }))
    }

    /// Reads the declared kind of each output.
    fn output_kinds(&self, outputs: &[String]) -> Result<Vec<Option<OutputKind>>, ModelError> {
        let mut kinds = vec![None; outputs.len()];
        let Some(value) = self.get("output_kinds") else {
            return Ok(kinds);
        };
        let keys = self.inner(value, "output_kinds")?;
        for (name, kind) in keys.object {
            let index = outputs.iter().position(|output| output == name);
            let unknown =
                || at(self.place, format!("output_kinds.{name}"), KeyProblem::UnknownChannel { name: name.clone() });
            let read = OutputKind::ALL.into_iter().find(|known| kind.as_str() == Some(known.name()));
            let wrong = || keys.kind(name, "position, velocity, acceleration, force or other");
            kinds[index.ok_or_else(unknown)?] = Some(read.ok_or_else(wrong)?);
        }
        Ok(kinds)
    }

    fn ports(&self) -> Result<Vec<Port>, ModelError> {
        let Some(value) = self.get("ports") else {
            return Ok(Vec::new());
        };
        let ports = self.array(value, "ports")?.iter().enumerate();
        ports.map(|(i, x)| self.port(x, i)).collect()
    }

    fn port(&self, value: &'a Value, index: usize) -> Result<Port, ModelError> {
        let keys = self.inner(value, &format!("ports[{index}]"))?;
        let list = |key: &str| keys.list(keys.need(key)?, key);
        let input = keys.get("input").map(|x| keys.string(x, "input"));
        Ok(Port {
            name: keys.string(keys.need("name")?, "name")?,
            input: input.transpose()?,
            force: list("force")?,
            displacement: list("displacement")?,
            velocity: list("velocity")?,
            output: keys.optional_list("output")?,
        })
    }
}
