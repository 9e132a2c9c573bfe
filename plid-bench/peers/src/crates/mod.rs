//! One file a library. Each is fed f(s), its Jacobian F and Qbar of the joint EKF, about the estimate after the
//! measurement.

mod ads;
mod bayes;
mod filters;
mod kf;
mod labbe;
mod mini;
mod multi;
mod num;
mod own;

pub use ads::Adskalman;
pub use bayes::{BayesCovariance, BayesUd};
pub use filters::KalmanFilters;
pub use kf::Kfilter;
pub use labbe::Kalmanfilt;
pub use mini::Minikalman;
pub use multi::Multicalc;
pub use num::Numeris;
pub use own::Plid;
