use super::{
    ActuatorCrosstalk, ActuatorDeadZone, ActuatorDelay, ActuatorGain, ActuatorGainDrift, ActuatorHysteresis,
    ActuatorLag, ActuatorSaturation, ActuatorSlewLimit, AddedDamping, AddedMass, AddedStiffness, Backlash, Clearance,
    ColouredDisturbance, CoulombFriction, CubicStiffness, Effect, EndStop, GravitySine, IwanJoint, JointHysteresis,
    MainsHum, MissingMode, ModalDamping, ModalFrequency, NarrowbandDisturbance, OneSidedStop, QuadraticDamping,
    QuadraticStiffness, SensorCrosstalk, SensorDelay, SensorDrift, SensorDropout, SensorGain, SensorLag, SensorNoise,
    SensorOffset, SensorQuantisation, SensorSaturation, StickFriction, StiffnessDrift,
};

/// The effects of a diagnosis.
pub struct Library {
    effects: Vec<Box<dyn Effect>>,
}

impl Library {
    /// Returns the whole vocabulary.
    pub fn standard() -> Self {
        let effects: Vec<Box<dyn Effect>> = vec![
            Box::new(ActuatorCrosstalk),
            Box::new(ActuatorDeadZone),
            Box::new(ActuatorDelay),
            Box::new(ActuatorGain),
            Box::new(ActuatorGainDrift),
            Box::new(ActuatorHysteresis),
            Box::new(ActuatorLag),
            Box::new(ActuatorSaturation),
            Box::new(ActuatorSlewLimit),
            Box::new(AddedDamping),
            Box::new(AddedMass),
            Box::new(AddedStiffness),
            Box::new(Backlash),
            Box::new(Clearance),
            Box::new(CoulombFriction),
            Box::new(CubicStiffness),
            Box::new(EndStop),
            Box::new(GravitySine),
            Box::new(IwanJoint),
            Box::new(JointHysteresis),
            Box::new(MainsHum),
            Box::new(MissingMode),
            Box::new(ModalDamping),
            Box::new(ModalFrequency),
            Box::new(NarrowbandDisturbance),
            Box::new(OneSidedStop),
            Box::new(QuadraticDamping),
            Box::new(QuadraticStiffness),
            Box::new(SensorCrosstalk),
            Box::new(SensorDelay),
            Box::new(SensorDrift),
            Box::new(SensorGain),
            Box::new(SensorLag),
            Box::new(SensorOffset),
            Box::new(SensorSaturation),
            Box::new(StickFriction),
            Box::new(StiffnessDrift),
            Box::new(ColouredDisturbance),
            Box::new(SensorDropout),
            Box::new(SensorNoise),
            Box::new(SensorQuantisation),
        ];
        Self { effects }
    }

    /// Adds an effect.
    pub fn with(mut self, effect: Box<dyn Effect>) -> Self {
        self.effects.push(effect);
        self
    }

    /// Removes the effects of these names.
    pub fn without(mut self, names: &[String]) -> Self {
        self.effects.retain(|effect| !names.iter().any(|name| name == effect.name()));
        self
    }

    /// Returns all effects.
    pub fn effects(&self) -> impl Iterator<Item = &dyn Effect> {
        self.effects.iter().map(AsRef::as_ref)
    }

    /// Returns an effect by its name.
    pub fn get(&self, name: &str) -> Option<&dyn Effect> {
        self.effects().find(|effect| effect.name() == name)
    }

    /// Returns the number of effects.
    pub fn len(&self) -> usize {
        self.effects.len()
    }

    /// Returns whether there is no effect.
    pub fn is_empty(&self) -> bool {
        self.effects.is_empty()
    }
}
