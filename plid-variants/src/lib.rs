//! Covariance forms and conditional expectations of plid
