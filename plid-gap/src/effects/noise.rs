use super::{Action, Effect, Parameter, Place, Range, Setting, Side};

/// An effect that a free run does not show: it is found in the noise and in the codes of the raw records.
macro_rules! unseen {
    ($(#[$doc:meta])* $kind:ident, $name:literal, $side:ident, $equation:literal, $parameters:expr, $places:expr) => {
        $(#[$doc])*
        pub struct $kind;

        impl Effect for $kind {
            fn name(&self) -> &'static str {
                $name
            }

            fn side(&self) -> Side {
                Side::$side
            }

            fn equation(&self) -> &'static str {
                $equation
            }

            fn parameters(&self, _setting: &Setting) -> Vec<Parameter> {
                $parameters
            }

            fn places(&self, setting: &Setting) -> Vec<Place> {
                let places: fn(&Setting) -> Vec<Place> = $places;
                places(setting)
            }

            fn starts(&self, _setting: &Setting, _place: &Place) -> Vec<Vec<f64>> {
                Vec::new()
            }

            fn act(&self, _setting: &Setting, _place: &Place, _parameters: &[f64]) -> Vec<Action> {
                vec![Action::Noise]
            }
        }
    };
}

unseen!(
    /// A sensor that is noisier than declared.
    SensorNoise,
    "sensor-noise",
    Sensor,
    "y' = y + white Gaussian noise on top of the declared",
    vec![Parameter::new("std", "V", Range::Positive)],
    Setting::outputs
);
unseen!(
    /// A channel that repeats its last good value now and then.
    SensorDropout,
    "sensor-dropout",
    Sensor,
    "at random instants the last good value repeats for a few samples",
    vec![Parameter::new("rate", "1/sample", Range::Positive)],
    Setting::outputs
);
unseen!(
    /// A random force in a band.
    ColouredDisturbance,
    "coloured-disturbance",
    Disturbance,
    "force along a strut: band-pass noise of standard deviation a round f",
    vec![Parameter::new("a", "force", Range::Positive), Parameter::new("f", "Hz", Range::Positive)],
    |_| Vec::new()
);
