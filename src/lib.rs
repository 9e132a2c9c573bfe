//! plid: pseudo-linear identification.
