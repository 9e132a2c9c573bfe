//! Blind trials, from drawing to scoring.

mod documented;
mod end_to_end;
mod families;
mod golden;
mod machinery;
