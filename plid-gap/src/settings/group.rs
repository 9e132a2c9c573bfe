//! The declaration of a group of settings: its struct, its defaults, and the metadata for the book and the checks come
//! from one list.

use std::ops::RangeInclusive;

/// One setting.
#[derive(Debug, Clone)]
pub struct Field {
    /// Its key in the case file.
    pub key: &'static str,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// The range of values that it may have.
    pub range: RangeInclusive<f64>,
    /// Its meaning, reason and source.
    pub about: &'static str,
}

/// The type of a setting's value, which can be converted to a number.
pub(super) trait Number: Copy {
    fn number(self) -> f64;
}

impl Number for f64 {
    fn number(self) -> f64 {
        self
    }
}

impl Number for usize {
    fn number(self) -> f64 {
        self as f64
    }
}

/// Declares a group. Each setting is a doc comment followed by `key: type = default, "unit", range;`. A setting that
/// had another key in earlier answers names that key between the two: `#[serde(alias = "...")]`.
macro_rules! group {
    (
        $(#[doc = $group:literal])+
        $name:ident {
            $(
                $(#[doc = $doc:literal])+
                $(#[serde(alias = $old:literal)])?
                $key:ident: $kind:ty = $default:expr, $unit:literal, $range:expr;
            )+
        }
    ) => {
        $(#[doc = $group])+
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            $( $(#[doc = $doc])+ $(#[serde(alias = $old)])? pub $key: $kind, )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($key: $default,)+ }
            }
        }

        impl $name {
            /// Returns the settings of the group in order.
            pub fn fields(&self) -> Vec<$crate::settings::Field> {
                vec![$(
                    $crate::settings::Field {
                        key: stringify!($key),
                        value: $crate::settings::group::Number::number(self.$key),
                        unit: $unit,
                        range: $range,
                        about: concat!($($doc),+).trim(),
                    }
                ),+]
            }
        }
    };
}

pub(super) use group;
