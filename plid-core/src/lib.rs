//! The PLID recursion: traits, canonical form, implicit model, noise model, identifier
