//! The speed study.
