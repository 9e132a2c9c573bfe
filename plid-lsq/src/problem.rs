//! The interface between the search and a problem.

use nalgebra::DVector;

/// A least-squares problem: the cost of a point, and its normal equations there.
///
/// A point holds the parameters in any form, together with quantities computed from them, such as the residual. Only
/// the problem itself moves a point along a step ([`Problem::advance`]), so a bound on a parameter is a change of
/// variables there, such as a step in the logarithm of a positive number.
pub trait Problem: Sync {
    /// The parameters and the quantities that were computed from them.
    type Point: Clone + Send + Sync;
    /// The linearised problem.
    type Equations: Equations;
    /// The reason why a point cannot be linearised.
    type Error;

    /// Returns storage for the equations, to be filled by [`Problem::linearise`].
    fn equations(&self) -> Self::Equations;

    /// Computes the normal equations at a point, including the prior.
    ///
    /// # Errors
    /// An error ends the search.
    fn linearise(&mut self, at: &Self::Point, equations: &mut Self::Equations) -> Result<(), Self::Error>;

    /// Computes the point that lies one step from another. `to` holds any point of this problem and is overwritten.
    fn advance(&self, from: &Self::Point, step: &DVector<f64>, to: &mut Self::Point);

    /// Returns the cost of a point: its sum of squares, or another function with the same minimum, such as a likelihood
    /// in which the noise variance is eliminated. A point with an infinite cost or NaN is rejected.
    fn cost(&self, at: &Self::Point) -> f64;

    /// Returns whether the search may continue from a point, for example whether there is time left for
    /// [`Problem::linearise`] and for steps from there. It is called before each linearisation. If the answer is no,
    /// the search ends at this point.
    fn may_go_on(&self, _at: &Self::Point) -> bool {
        true
    }

    /// Receives every point that the search moves to. The problem may change the coordinates of the point but not its
    /// cost.
    fn accepted(&mut self, _at: &mut Self::Point) {}
}

/// Normal equations that can be solved with any damping.
pub trait Equations: Sync {
    /// Working storage of one solution. Each of the steps that are tried in parallel has its own.
    type Work: Default + Send;

    /// Solves for a step with the given damping. Returns whether there is a finite solution. `step` holds an earlier
    /// step or is empty.
    fn solve(&self, damping: f64, work: &mut Self::Work, step: &mut DVector<f64>) -> bool;
}
