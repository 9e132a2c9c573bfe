//! Matrix backends of plid: nalgebra, faer, plain loops
