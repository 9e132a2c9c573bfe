//! Benches of plid
