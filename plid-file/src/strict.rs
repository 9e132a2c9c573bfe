//! JSON without `null` where a number belongs.
//!
//! JSON has no NaN and no infinity. serde writes `null` in their place, and a reader then finds no number, or does
//! not notice the error at all. [`to_json`] and [`to_line`] therefore check every number of a value before they write
//! anything, and name the first one that is not finite by its path. A `null` inside a [`serde_json::Value`] is
//! refused as well, because it may have been such a number. A value that is not available has no key. A typed field
//! for it is an `Option` that is skipped if it is `None`.

use serde::Serialize;
use serde::ser;
use serde_json::Value;
use std::fmt;

/// A number that is not finite, and its place.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{path}` is {value}, which is not allowed where a file must contain a number")]
pub struct NotFinite {
    /// The keys and indices that lead to the number, such as `effects[0].parameters.k`.
    pub path: String,
    /// `NaN`, `inf`, `-inf` or `null`.
    pub value: String,
}

/// Returns a value as indented JSON with a newline at its end.
///
/// # Errors
/// Returns [`NotFinite`] for the first number that is not finite.
///
/// # Panics
/// Panics if the type cannot be represented in JSON (such as a map whose keys are not text), which is a fault of the
/// type and not of the value.
pub fn to_json<T: Serialize + ?Sized>(value: &T) -> Result<String, NotFinite> {
    require_finite(value)?;
    let mut text = serde_json::to_string_pretty(value).expect("plain data are JSON by construction");
    text.push('\n');
    Ok(text)
}

/// Returns a value as one line of JSON with a newline at its end.
///
/// # Errors
/// Returns [`NotFinite`] for the first number that is not finite.
///
/// # Panics
/// Panics as [`to_json`] does.
pub fn to_line<T: Serialize + ?Sized>(value: &T) -> Result<String, NotFinite> {
    require_finite(value)?;
    let mut text = serde_json::to_string(value).expect("plain data are JSON by construction");
    text.push('\n');
    Ok(text)
}

/// Returns a value as a [`Value`] from which a file can be built. A field that is `None` has no key.
///
/// # Errors
/// Returns [`NotFinite`] for the first number that is not finite.
///
/// # Panics
/// Panics as [`to_json`] does.
pub fn to_value<T: Serialize + ?Sized>(value: &T) -> Result<Value, NotFinite> {
    require_finite(value)?;
    let mut value = serde_json::to_value(value).expect("plain data are JSON by construction");
    drop_absent(&mut value);
    Ok(value)
}

/// Removes the keys without a value. After [`require_finite`] these are the fields that are `None`.
fn drop_absent(value: &mut Value) {
    match value {
        Value::Object(fields) => {
            fields.retain(|_, value| !value.is_null());
            fields.values_mut().for_each(drop_absent);
        }
        Value::Array(items) => items.iter_mut().for_each(drop_absent),
        _ => {}
    }
}

/// Checks that every number of a value is finite.
///
/// # Errors
/// Returns [`NotFinite`] for the first number that is not finite.
///
/// # Panics
/// Panics as [`to_json`] does.
pub fn require_finite<T: Serialize + ?Sized>(value: &T) -> Result<(), NotFinite> {
    let mut walk = Walk { path: Vec::new(), item: Vec::new() };
    value.serialize(&mut walk).map_err(|stop| match stop {
        Stop::NotFinite(value) => NotFinite { path: walk.path(), value },
        Stop::Type(message) => panic!("plain data are JSON by construction: {message}"),
    })
}

/// A serializer that writes nothing, and stops at the first number that is not finite.
struct Walk {
    /// Names of the fields and indices of the items that lead to the current value.
    path: Vec<String>,
    /// Index of the next item in each open sequence.
    item: Vec<usize>,
}

impl Walk {
    fn path(&self) -> String {
        let path = self.path.concat();
        path.strip_prefix('.').map_or(path.clone(), str::to_string)
    }

    /// Walks through a part. If a number stops the walk, the path still leads to this number.
    fn part<T: Serialize + ?Sized>(&mut self, step: String, value: &T) -> Result<(), Stop> {
        self.path.push(step);
        value.serialize(&mut *self)?;
        self.path.pop();
        Ok(())
    }

    fn next<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Stop> {
        let item = self.item.last_mut().expect("a sequence is open");
        let step = format!("[{item}]");
        *item += 1;
        self.part(step, value)
    }
}

#[derive(Debug)]
enum Stop {
    NotFinite(String),
    Type(String),
}

impl fmt::Display for Stop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self:?}")
    }
}

impl std::error::Error for Stop {}

impl ser::Error for Stop {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::Type(message.to_string())
    }
}

/// Methods for values that contain no floating-point number.
macro_rules! nothing {
    ($($name:ident: $kind:ty),* $(,)?) => { $(fn $name(self, _: $kind) -> Result<(), Stop> { Ok(()) })* };
}

impl<'a> ser::Serializer for &'a mut Walk {
    type Ok = ();
    type Error = Stop;
    type SerializeSeq = &'a mut Walk;
    type SerializeTuple = &'a mut Walk;
    type SerializeTupleStruct = &'a mut Walk;
    type SerializeTupleVariant = &'a mut Walk;
    type SerializeMap = &'a mut Walk;
    type SerializeStruct = &'a mut Walk;
    type SerializeStructVariant = &'a mut Walk;

    nothing! {
        serialize_bool: bool, serialize_i8: i8, serialize_i16: i16, serialize_i32: i32, serialize_i64: i64,
        serialize_u8: u8, serialize_u16: u16, serialize_u32: u32, serialize_u64: u64, serialize_char: char,
        serialize_str: &str, serialize_bytes: &[u8], serialize_unit_struct: &'static str,
    }

    fn serialize_f32(self, x: f32) -> Result<(), Stop> {
        self.serialize_f64(f64::from(x))
    }

    fn serialize_f64(self, x: f64) -> Result<(), Stop> {
        if x.is_finite() { Ok(()) } else { Err(Stop::NotFinite(x.to_string())) }
    }

    fn serialize_none(self) -> Result<(), Stop> {
        Ok(())
    }

    fn serialize_unit(self) -> Result<(), Stop> {
        Err(Stop::NotFinite("null".into()))
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<(), Stop> {
        value.serialize(self)
    }

    fn serialize_unit_variant(self, _: &'static str, _: u32, _: &'static str) -> Result<(), Stop> {
        Ok(())
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Result<(), Stop> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        variant: &'static str,
        value: &T,
    ) -> Result<(), Stop> {
        self.part(format!(".{variant}"), value)
    }

    fn serialize_seq(self, _: Option<usize>) -> Result<Self, Stop> {
        self.item.push(0);
        Ok(self)
    }

    fn serialize_tuple(self, _: usize) -> Result<Self, Stop> {
        self.serialize_seq(None)
    }

    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Self, Stop> {
        self.serialize_seq(None)
    }

    fn serialize_tuple_variant(self, _: &'static str, _: u32, _: &'static str, _: usize) -> Result<Self, Stop> {
        self.serialize_seq(None)
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Self, Stop> {
        Ok(self)
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self, Stop> {
        Ok(self)
    }

    fn serialize_struct_variant(self, _: &'static str, _: u32, _: &'static str, _: usize) -> Result<Self, Stop> {
        Ok(self)
    }
}

/// Sequences are walked through by index, and structs by the names of their fields.
macro_rules! parts {
    ($($kind:ident => $method:ident),* $(,)?) => { $(impl ser::$kind for &mut Walk {
        type Ok = ();
        type Error = Stop;

        fn $method<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Stop> {
            self.next(value)
        }

        fn end(self) -> Result<(), Stop> {
            self.item.pop();
            Ok(())
        }
    })* };
    ($($kind:ident),*) => { $(impl ser::$kind for &mut Walk {
        type Ok = ();
        type Error = Stop;

        fn serialize_field<T: Serialize + ?Sized>(&mut self, key: &'static str, value: &T) -> Result<(), Stop> {
            self.part(format!(".{key}"), value)
        }

        fn end(self) -> Result<(), Stop> {
            Ok(())
        }
    })* };
}

parts! {
    SerializeSeq => serialize_element, SerializeTuple => serialize_element, SerializeTupleStruct => serialize_field,
    SerializeTupleVariant => serialize_field,
}
parts! { SerializeStruct, SerializeStructVariant }

impl ser::SerializeMap for &mut Walk {
    type Ok = ();
    type Error = Stop;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), Stop> {
        let key = serde_json::to_value(key).map_err(ser::Error::custom)?;
        self.path.push(format!(".{}", key.as_str().map_or_else(|| key.to_string(), str::to_string)));
        Ok(())
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), Stop> {
        value.serialize(&mut **self)?;
        self.path.pop();
        Ok(())
    }

    fn end(self) -> Result<(), Stop> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[derive(Serialize)]
    struct Inner {
        value: f64,
        interval: Option<[f64; 2]>,
    }

    #[derive(Serialize)]
    enum Kind {
        Nothing,
        Line(f64),
        Band { low: f64 },
    }

    #[derive(Serialize)]
    struct Outer {
        parts: Vec<BTreeMap<String, Inner>>,
        kinds: (Kind, Kind, Kind),
    }

    fn outer(value: f64, end: f64, line: f64, low: f64) -> Outer {
        let part = |value| BTreeMap::from([("k".to_string(), Inner { value, interval: Some([0.0, end]) })]);
        Outer { parts: vec![part(1.0), part(value)], kinds: (Kind::Nothing, Kind::Line(line), Kind::Band { low }) }
    }

    #[test]
    fn a_number_that_is_not_finite_is_named_by_its_path() {
        let fine = outer(1.0, 2.0, 3.0, 4.0);
        assert_eq!(to_json(&fine).unwrap(), serde_json::to_string_pretty(&fine).unwrap() + "\n");
        assert_eq!(to_line(&fine).unwrap(), serde_json::to_string(&fine).unwrap() + "\n");
        let said = |outer: &Outer| {
            let error = to_json(outer).unwrap_err();
            assert_eq!(to_line(outer).unwrap_err(), error);
            error
        };
        let nan = said(&outer(f64::NAN, 2.0, 3.0, 4.0));
        assert_eq!(nan.path, "parts[1].k.value");
        assert!(nan.to_string().contains("is NaN"), "{nan}");
        assert_eq!(said(&outer(1.0, f64::INFINITY, 3.0, 4.0)).path, "parts[0].k.interval[1]");
        assert_eq!(said(&outer(1.0, 2.0, f64::NEG_INFINITY, 4.0)).path, "kinds[1].Line");
        assert_eq!(said(&outer(1.0, 2.0, 3.0, f64::NAN)).path, "kinds[2].low");
        assert_eq!(to_json(&f64::NAN).unwrap_err().path, "");
    }

    #[test]
    fn a_field_without_a_value_has_no_key() {
        let inner = |interval| vec![Inner { value: 1.0, interval }];
        assert_eq!(to_value(&inner(None)).unwrap(), serde_json::json!([{ "value": 1.0 }]));
        assert_eq!(to_value(&inner(Some([0.0, f64::NAN]))).unwrap_err().path, "[0].interval[1]");
    }

    #[test]
    fn a_null_in_a_value_is_refused() {
        let error = to_json(&serde_json::json!({ "a": [1.0, f64::NAN] })).unwrap_err();
        assert_eq!((error.path.as_str(), error.value.as_str()), ("a[1]", "null"));
    }
}
