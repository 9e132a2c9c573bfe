//! modelDescription.xml: the description of an FMU.

use std::collections::BTreeMap;

use plid_simulator::OutputKind;
use roxmltree::{Document, Node};

use crate::unit;

/// A version of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Version {
    /// FMI 2.0.
    Two,
    /// FMI 3.0.
    Three,
}

/// A fault of a description.
#[derive(Debug)]
pub(crate) enum Fault {
    /// The description violates the standard.
    Malformed(String),
    /// The FMU follows another version of the standard.
    Version(String),
    /// The FMU does not support co-simulation, but only these kinds of simulation.
    Kind(String),
}

/// The description of an FMU.
#[derive(Debug)]
pub(crate) struct ModelDescription {
    pub version: Version,
    pub name: String,
    /// The GUID of FMI 2.0, the instantiation token of FMI 3.0.
    pub token: String,
    /// Name of the binary.
    pub identifier: String,
    /// Whether the FMU needs another program to be installed.
    pub needs_tool: bool,
    /// Whether its state can be stored and restored.
    pub keeps_states: bool,
    /// Whether a process may have only one instance of it.
    pub one_instance: bool,
    /// Whether its step size is fixed.
    pub fixed_step: bool,
    pub start_time: f64,
    /// The step size of the default experiment in s.
    pub step_size: Option<f64>,
    pub variables: Vec<Variable>,
}

/// A variable.
#[derive(Debug)]
pub(crate) struct Variable {
    pub name: String,
    pub reference: u32,
    pub causality: String,
    pub variability: String,
    /// Its type, which is "Real" or "Float64" if the variable can be used.
    pub kind: String,
    pub is_array: bool,
    pub start: Option<f64>,
    pub min: Option<f64>,
    pub max: Option<f64>,
    pub unit: Option<String>,
    /// The quantity that follows from its unit.
    pub quantity: Option<OutputKind>,
}

impl Variable {
    /// Returns whether it is a single number of double precision.
    pub fn is_real(&self) -> bool {
        !self.is_array && matches!(self.kind.as_str(), "Real" | "Float64")
    }

    /// Returns what it is, in words.
    pub fn in_words(&self) -> String {
        let array = if self.is_array { "an array of " } else { "" };
        format!("{array}{} with causality {:?} and variability {:?}", self.kind, self.causality, self.variability)
    }
}

/// Bounds beyond this size are ignored, because Modelica tools write 1e60 for infinity.
const BOUNDLESS: f64 = 1e30;

impl ModelDescription {
    pub fn parse(text: &str) -> Result<Self, Fault> {
        // Some tools write a byte order mark.
        let document = Document::parse(text.trim_start_matches('\u{feff}'))
            .map_err(|error| Fault::Malformed(error.to_string()))?;
        let root = document.root_element();
        let number = required(root, "fmiVersion")?;
        let version = match number.split('.').next() {
            Some("2") => Version::Two,
            Some("3") => Version::Three,
            _ => return Err(Fault::Version(number)),
        };
        let Some(simulation) = child(root, "CoSimulation") else { return Err(Fault::Kind(kinds(root))) };
        let token = if version == Version::Two { "guid" } else { "instantiationToken" };
        let experiment = child(root, "DefaultExperiment");
        let time = |key: &str| experiment.and_then(|experiment| float(experiment, key));
        let flag = |key: &str| simulation.attribute(key).is_some_and(is_true);
        let internal = float(simulation, "fixedInternalStepSize");
        let state = if version == Version::Two { "canGetAndSetFMUstate" } else { "canGetAndSetFMUState" };
        Ok(Self {
            version,
            name: required(root, "modelName")?,
            token: required(root, token)?,
            identifier: required(simulation, "modelIdentifier")?,
            needs_tool: flag("needsExecutionTool"),
            keeps_states: flag(state),
            one_instance: flag("canBeInstantiatedOnlyOncePerProcess"),
            fixed_step: !flag("canHandleVariableCommunicationStepSize"),
            start_time: time("startTime").filter(|time| time.is_finite()).unwrap_or(0.0),
            step_size: internal.or(time("stepSize")).filter(|step| step.is_finite() && *step > 0.0),
            variables: variables(root, version)?,
        })
    }
}

impl ModelDescription {
    /// Returns a possible reason for a failure, for the end of a message.
    pub fn tool(&self) -> &'static str {
        if self.needs_tool { " (it needs its own tool to be installed)" } else { "" }
    }
}

fn child<'a, 'i>(of: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    of.children().find(|node| node.has_tag_name(name))
}

fn elements<'a, 'i>(of: Node<'a, 'i>, name: &str) -> impl Iterator<Item = Node<'a, 'i>> + use<'a, 'i> {
    child(of, name).into_iter().flat_map(|node| node.children().filter(Node::is_element))
}

fn required(of: Node<'_, '_>, key: &str) -> Result<String, Fault> {
    let missing = || Fault::Malformed(format!("<{}> has no attribute `{key}`", of.tag_name().name()));
    of.attribute(key).map(str::to_string).ok_or_else(missing)
}

fn float(of: Node<'_, '_>, key: &str) -> Option<f64> {
    of.attribute(key).and_then(|text| text.trim().parse().ok())
}

fn is_true(text: &str) -> bool {
    matches!(text.trim(), "true" | "1")
}

/// Returns the kinds of simulation of an FMU without co-simulation.
fn kinds(root: Node<'_, '_>) -> String {
    let known = [("ModelExchange", "model exchange"), ("ScheduledExecution", "scheduled execution")];
    let has: Vec<&str> = known.iter().filter(|(tag, _)| child(root, tag).is_some()).map(|(_, name)| *name).collect();
    if has.is_empty() { "no kind of simulation".into() } else { has.join(" and ") }
}

fn variables(root: Node<'_, '_>, version: Version) -> Result<Vec<Variable>, Fault> {
    let units = units(root);
    let types = types(root, version);
    let mut found = Vec::new();
    for node in elements(root, "ModelVariables") {
        // FMI 2.0 states the type in a child element.
        let typed = match version {
            Version::Two => node.children().find(Node::is_element),
            Version::Three => Some(node),
        };
        let Some(typed) = typed else { continue };
        let declared = typed.attribute("declaredType").and_then(|name| types.get(name));
        let of = |key: &str| typed.attribute(key).or_else(|| declared.and_then(|declared| declared.attribute(key)));
        let bound = |key: &str| {
            let bound = of(key).and_then(|text| text.trim().parse().ok());
            bound.filter(|bound: &f64| bound.abs() < BOUNDLESS)
        };
        let unit = of("unit").filter(|unit| !unit.is_empty() && *unit != "1");
        let name = required(node, "name")?;
        let reference = required(node, "valueReference")?;
        let wrong = |_| Fault::Malformed(format!("variable {name:?}: {reference:?} is not a value reference"));
        let default = |key: &str, otherwise: &str| node.attribute(key).unwrap_or(otherwise).to_string();
        found.push(Variable {
            reference: reference.parse().map_err(wrong)?,
            causality: default("causality", "local"),
            variability: default("variability", "continuous"),
            kind: typed.tag_name().name().to_string(),
            is_array: child(node, "Dimension").is_some(),
            start: float(typed, "start"),
            min: bound("min"),
            max: bound("max"),
            quantity: unit.and_then(|unit| unit::quantity(unit, units.get(unit))),
            unit: unit.map(str::to_string),
            name,
        });
    }
    Ok(found)
}

/// Returns the exponents of the base units for each unit that states them.
fn units(root: Node<'_, '_>) -> BTreeMap<String, unit::Exponents> {
    let read = |node: Node<'_, '_>| {
        let base = child(node, "BaseUnit")?;
        let exponent = |key: &str| base.attribute(key).and_then(|text| text.parse().ok()).unwrap_or(0);
        Some((node.attribute("name")?.to_string(), unit::BASE.map(exponent)))
    };
    elements(root, "UnitDefinitions").filter_map(read).collect()
}

/// Returns the declared types of real variables, by name.
fn types<'a, 'i>(root: Node<'a, 'i>, version: Version) -> BTreeMap<String, Node<'a, 'i>> {
    let read = |node: Node<'a, 'i>| {
        let typed = if version == Version::Two { child(node, "Real")? } else { node };
        Some((node.attribute("name")?.to_string(), typed))
    };
    elements(root, "TypeDefinitions").filter_map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &str = r#"<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="m" guid="{g}">
  <CoSimulation modelIdentifier="id" needsExecutionTool="true" canHandleVariableCommunicationStepSize="true"/>
  <UnitDefinitions><Unit name="knots"><BaseUnit m="1" s="-1" factor="0.514"/></Unit></UnitDefinitions>
  <TypeDefinitions><SimpleType name="Mass"><Real unit="kg" min="0.1" max="1e60"/></SimpleType></TypeDefinitions>
  <LogCategories><Category name="logStatusError"/></LogCategories>
  <DefaultExperiment startTime="1" stepSize="0.002"/>
  <ModelVariables>
    <ScalarVariable name="mass" valueReference="7" causality="parameter" variability="tunable">
      <Real declaredType="Mass" start="2.5"/></ScalarVariable>
    <ScalarVariable name="speed" valueReference="8" causality="output"><Real unit="knots"/></ScalarVariable>
    <ScalarVariable name="count" valueReference="9"><Integer start="1"/></ScalarVariable>
  </ModelVariables>
</fmiModelDescription>"#;

    #[test]
    fn types_and_units_are_inherited() {
        let read = ModelDescription::parse(TWO).unwrap();
        assert!(read.needs_tool && !read.fixed_step && read.version == Version::Two);
        assert_eq!((read.start_time, read.step_size, read.token.as_str()), (1.0, Some(0.002), "{g}"));
        let [mass, speed, count] = &read.variables[..] else { panic!("{:?}", read.variables) };
        assert_eq!((mass.start, mass.min, mass.max, mass.unit.as_deref()), (Some(2.5), Some(0.1), None, Some("kg")));
        assert!(mass.is_real() && mass.variability == "tunable");
        assert_eq!((speed.quantity, speed.variability.as_str()), (Some(OutputKind::Velocity), "continuous"));
        assert!(!count.is_real() && count.causality == "local");
    }

    #[test]
    fn arrays_of_fmi_3_are_no_numbers() {
        let text = r#"<fmiModelDescription fmiVersion="3.0.1" modelName="m" instantiationToken="t">
          <CoSimulation modelIdentifier="id"/><ModelVariables>
          <Float64 name="x" valueReference="1" causality="output" unit="rad/s" min="-1"/>
          <Float64 name="xs" valueReference="2"><Dimension start="3"/></Float64>
          </ModelVariables></fmiModelDescription>"#;
        let read = ModelDescription::parse(text).unwrap();
        assert!(read.fixed_step && read.variables[0].is_real() && !read.variables[1].is_real());
        assert_eq!((read.variables[0].quantity, read.variables[0].min), (Some(OutputKind::Velocity), Some(-1.0)));
    }

    #[test]
    fn other_files_are_refused() {
        let parse = |text: &str| ModelDescription::parse(text).unwrap_err();
        let one = r#"<fmiModelDescription fmiVersion="1.0" modelName="m"/>"#;
        assert!(matches!(parse(one), Fault::Version(version) if version == "1.0"));
        let exchange = TWO.replace("CoSimulation", "ModelExchange");
        assert!(matches!(parse(&exchange), Fault::Kind(has) if has == "model exchange"));
        assert!(matches!(parse(&TWO.replace("guid", "id")), Fault::Malformed(text) if text.contains("`guid`")));
        let reference = TWO.replace("\"8\"", "\"-8\"");
        assert!(matches!(parse(&reference), Fault::Malformed(text) if text.contains("\"speed\"")));
        assert!(matches!(parse("<fmi"), Fault::Malformed(_)));
    }
}
