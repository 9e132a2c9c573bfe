use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// The variables of a simulator that make a port, by their names. As text it is `NAME=FORCE,DISPLACEMENT,VELOCITY`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PortVariables {
    /// Its name.
    pub name: String,
    /// The input that takes the force.
    pub force: String,
    /// The variable that shows the displacement.
    pub displacement: String,
    /// The variable that shows the velocity.
    pub velocity: String,
}

impl FromStr for PortVariables {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('=').map(|(name, rest)| (name, split(rest)));
        match parts {
            Some((name, parts))
                if !name.is_empty() && parts.len() == 3 && parts.iter().all(|part| !part.is_empty()) =>
            {
                let [force, displacement, velocity] = [0, 1, 2].map(|k: usize| parts[k].to_string());
                Ok(Self { name: name.into(), force, displacement, velocity })
            }
            _ => Err(format!("{text:?} is not NAME=FORCE,DISPLACEMENT,VELOCITY")),
        }
    }
}

/// Splits at commas. Those within brackets belong to names, such as `x[1,2]`.
fn split(text: &str) -> Vec<&str> {
    let mut depth = 0;
    let at_comma = |c: char| {
        depth += i32::from(matches!(c, '[' | '(')) - i32::from(matches!(c, ']' | ')'));
        depth == 0 && c == ','
    };
    text.split(at_comma).map(str::trim).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_is_read_from_text() {
        let port: PortVariables = "joint=u[1,2], x[1,2],der(x[1,2])".parse().unwrap();
        let parts = [&port.name, &port.force, &port.displacement, &port.velocity];
        assert_eq!(parts, ["joint", "u[1,2]", "x[1,2]", "der(x[1,2])"]);
        for wrong in ["joint", "joint=f,x", "=f,x,v", "joint=f,,v", "joint=f,x,v,a"] {
            assert!(wrong.parse::<PortVariables>().unwrap_err().contains("NAME=FORCE"), "{wrong}");
        }
    }
}
