//! The simulated truss of Vallone and Hopkins (1995): structure, actuators, sensors, converters
