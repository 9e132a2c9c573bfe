//! The names of variants. Built-in variants have constants; a program may add others at its start.

use std::fmt::Display;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

use crate::registry::registry;

/// A kind of name. Its constants come from the list of built-in variants.
macro_rules! name {
    ($(#[$doc:meta])* $name:ident, default $default:ident, of $known:ident;
     $($(#[$entry:meta])* $word:literal = $constant:ident $(: [$($scalar:ty),+], feature [$($feature:tt)*])?;)*) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(&'static str);

        // A constant is spelled like the type that it names.
        #[allow(non_upper_case_globals)]
        impl $name {
            $($(#[$entry])* pub const $constant: Self = Self($word);)*
            /// The built-in names.
            pub const BUILT_IN: [Self; [$($word),*].len()] = [$(Self::$constant),*];
        }

        impl $name {
            /// The built-in names, followed by those that the program has added.
            pub fn all() -> Vec<Self> {
                registry().$known.iter().map(|entry| Self(entry.name)).collect()
            }

            /// The name in configs.
            pub const fn as_str(self) -> &'static str {
                self.0
            }
        }

        impl Default for $name {
            fn default() -> Self {
                Self::$default
            }
        }

        impl Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.0)
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.0)
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let word = std::borrow::Cow::<'de, str>::deserialize(deserializer)?;
                let all = Self::all();
                all.iter().copied().find(|name| name.0 == word).ok_or_else(|| {
                    let known: Vec<String> = all.iter().map(|name| format!("`{name}`")).collect();
                    D::Error::custom(format!("unknown variant `{word}`, expected one of {}", known.join(", ")))
                })
            }
        }
    };
}

macro_rules! covariance_names {
    ($($list:tt)*) => {
        name! { /** How P is carried. */ CovarianceName, default BiermanUd, of forms; $($list)* }
    };
}
macro_rules! expectation_names {
    ($($list:tt)*) => {
        name! {
            /** What is taken as known when noise multiplies an unknown parameter. */
            ExpectationName, default MomentMatched, of expectations; $($list)*
        }
    };
}
macro_rules! backend_names {
    ($($list:tt)*) => {
        name! { /** The matrix library. */ BackendName, default Plain, of backends; $($list)* }
    };
}

plid_variants::every_form!(covariance_names);
plid_variants::every_expectation!(expectation_names);
plid_backends::every_backend!(backend_names);

/// The number type.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ScalarName {
    /// Single precision.
    F32,
    /// Double precision.
    #[default]
    F64,
    /// Double-double, about 31 digits.
    DoubleDouble,
}
