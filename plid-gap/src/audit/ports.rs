//! The ports that a case declares.

use plid_model::OutputKind;

use crate::case::{Case, PortConfig};
use crate::error::GapError;
use crate::plant::CasePort;

/// Returns the ports of a case with the indices of their channels.
///
/// # Errors
/// Returns [`GapError::Port`] if a channel is unknown, or if an output is declared to measure no motion.
pub fn of_case(case: &Case) -> Result<Vec<CasePort>, GapError> {
    let one = |port: &PortConfig| {
        let refused = |message: String| GapError::Port { name: port.name.clone(), message };
        let at = |names: &[String], name: &str| names.iter().position(|other| other == name);
        let input = at(&case.config.inputs, &port.input);
        let output = at(&case.config.outputs, &port.output);
        let unknown = || refused(format!("{} or {} is not a channel of the case", port.input, port.output));
        let (input, output) = input.zip(output).ok_or_else(unknown)?;
        let kinds = case.model.as_ref().map_or(&[][..], |model| &model.output_kinds);
        let kind = kinds.get(output).copied().flatten();
        match kind.filter(|kind| matches!(kind, OutputKind::Force | OutputKind::Other)) {
            Some(kind) => {
                Err(refused(format!("{} is declared as `{}`, which is not a motion", port.output, kind.name())))
            }
            None => Ok(CasePort { name: port.name.clone(), input, output }),
        }
    };
    case.config.port.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn a_force_sensor_shows_no_motion() {
        let mut case = testing::case(&testing::truss(1), &testing::truss(1));
        case.config.port =
            vec![PortConfig { name: "strut".into(), input: case.config.inputs[1].clone(), output: "y1".into() }];
        let found = of_case(&case).unwrap();
        assert_eq!(found, [CasePort { name: "strut".into(), input: 1, output: 0 }]);
        case.model.as_mut().unwrap().output_kinds[0] = Some(OutputKind::Force);
        let said = of_case(&case).unwrap_err().to_string();
        assert!(said.contains("[[port]] `strut`") && said.contains("not a motion"), "{said}");
    }
}
