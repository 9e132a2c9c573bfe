//! Blind trials, from drawing to scoring.

mod end_to_end;
mod golden;
mod machinery;
