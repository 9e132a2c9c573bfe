//! The notation of a law in a config's list: `law = "stribeck"`, or with numbers for its shape `law = { stribeck = {
//! speed = 7.0 } }`. Numbers that are left out have their fixed values.

use serde::de::{DeserializeOwned, Error as _};
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Value, json};

use super::family::Shape;

/// The laws of the same physics.
pub(crate) trait Laws: Serialize + DeserializeOwned {
    /// The numbers of the laws whose shapes form families.
    const SHAPES: &'static [Shape];
}

/// Writes a law by its name alone if its numbers have their fixed values.
pub(crate) fn serialize<L: Laws, S: Serializer>(law: &L, serializer: S) -> Result<S::Ok, S::Error> {
    let written = serde_json::to_value(law).map_err(S::Error::custom)?;
    let fixed = |shape: &Shape| written[shape.law][shape.number] == shape.fixed;
    let name = written.as_object().and_then(|law| law.keys().next());
    match name.filter(|name| L::SHAPES.iter().filter(|shape| shape.law == **name).all(fixed)) {
        Some(name) => name.serialize(serializer),
        None => written.serialize(serializer),
    }
}

/// Reads a law.
pub(crate) fn deserialize<'de, L: Laws, D: Deserializer<'de>>(deserializer: D) -> Result<L, D::Error> {
    let mut written = Value::deserialize(deserializer)?;
    if let Some(name) = written.as_str().filter(|name| L::SHAPES.iter().any(|shape| shape.law == *name)) {
        written = json!({ name: {} });
    }
    for shape in L::SHAPES {
        if let Some(numbers) = written.get_mut(shape.law).and_then(Value::as_object_mut) {
            numbers.entry(shape.number).or_insert_with(|| shape.fixed.into());
        }
    }
    serde_json::from_value(written).map_err(D::Error::custom)
}
