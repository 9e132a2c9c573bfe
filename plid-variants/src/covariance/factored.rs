//! P as a triangular factor. The common parts of the factored forms are here; a rule holds their differences.

use std::marker::PhantomData;

use plid_core::kernels::BadPivot;
use plid_core::{
    Backend, Checkpointed, CovariancePropagation, Dense, Form, FormFacts, Health, ImplicitModel, InitialCovariance,
    Inspect, NoiseTerms, Scalar, ScalarUpdate, StepSize, Term, Transition, Unsupported, ViewMut,
};

use super::corner::{Corner, Laid};
use super::triangular::{Triangular, Updates};

/// The rule by which the factors of P are kept and updated.
pub trait FactorRule: Clone + Send + Sync + 'static {
    /// Operations per entry of the factor and per measurement.
    const MEASUREMENT_FLOPS: f64;

    /// Operations of the triangularisation, divided by n^3.
    const TRIANGULARISATION_FLOPS: f64;

    /// Converts U and d of P0 = U diag(d) U^T to the convention of this rule.
    fn begin<B: Backend>(factors: &mut Triangular<B>);

    /// Returns the kernels of the measurement update.
    fn updates<B: Backend>() -> Updates<B::Scalar>;

    /// Makes the array in `corner` triangular, and writes the result to `u` in place of Ux (and to its n entries of
    /// d).
    fn triangularise<B: Backend>(
        corner: &mut Corner<B::Scalar>,
        laid: Laid,
        u: ViewMut<'_, B::Scalar>,
        d: &mut [B::Scalar],
    );

    /// Returns an error with the first pivot that is no longer sound after a time update.
    fn check<B: Backend>(factors: &Triangular<B>) -> Result<(), BadPivot>;

    /// Adds variance `c` to entry `place` of s.
    fn inflate<B: Backend>(factors: &mut Triangular<B>, place: usize, c: B::Scalar);

    /// Multiplies P by `factor`.
    fn scale<B: Backend>(factors: &mut Triangular<B>, factor: B::Scalar);

    /// Returns pivot `j` of U diag(d) U^T with U unit triangular.
    fn pivot<B: Backend>(factors: &Triangular<B>, j: usize) -> B::Scalar;
}

/// P = U diag(d) U^T with U upper triangular, by the rule `R`.
#[derive(Clone, Debug)]
pub struct Factored<B: Backend, R> {
    factors: Triangular<B>,
    rule: PhantomData<R>,
}

impl<B: Backend, R: FactorRule> CovariancePropagation for Factored<B, R> {
    type Scalar = B::Scalar;
    type Options = ();

    fn new(model: &dyn ImplicitModel, initial: &InitialCovariance, _: &()) -> Result<Self, BadPivot> {
        let mut factors = Triangular::<B>::new(model, initial)?;
        R::begin(&mut factors);
        Ok(Self { factors, rule: PhantomData })
    }

    fn output_columns(&self, rows: &[usize], out: ViewMut<'_, B::Scalar>) {
        self.factors.output_columns(rows, out);
    }

    fn add_parameter_blocks(&mut self, weights: &Dense<B::Scalar>, out: ViewMut<'_, B::Scalar>) {
        self.factors.add_parameter_blocks(weights, out);
    }

    fn measurement_update(
        &mut self,
        rows: &[usize],
        noise: &NoiseTerms<B::Scalar>,
        innovation: &[B::Scalar],
        s: &mut [B::Scalar],
    ) -> Result<(), BadPivot> {
        self.factors.measure(rows, noise, innovation, s, R::updates::<B>())
    }

    fn time_update(&mut self, _model: &dyn ImplicitModel, transition: &Transition<B::Scalar>) -> Result<(), BadPivot> {
        self.factors.time_update(transition, R::triangularise::<B>)?;
        R::check(&self.factors)
    }

    fn scale(&mut self, factor: B::Scalar) -> Result<(), Unsupported> {
        R::scale(&mut self.factors, factor);
        Ok(())
    }

    fn add_parameter_noise(&mut self, q: B::Scalar, step: u64) -> Result<(), Unsupported> {
        let (n, size) = (self.factors.layout.n(), self.factors.layout.size());
        let parameters = size - n;
        let place = n + (step % parameters as u64) as usize;
        R::inflate(&mut self.factors, place, q * B::Scalar::from_f64(parameters as f64));
        Ok(())
    }
}

impl<B: Backend, R: FactorRule> Inspect for Factored<B, R> {
    fn dense_in<T: Scalar>(&self) -> Dense<T> {
        self.factors.dense_in()
    }

    fn health(&self) -> Health {
        let pivots = (0..self.factors.d.len()).map(|j| R::pivot(&self.factors, j).to_f64());
        Health::from_pivots(pivots, 0.0)
    }
}

impl<B: Backend, R: FactorRule> Checkpointed for Factored<B, R> {
    fn state(&self) -> Vec<B::Scalar> {
        self.factors.state()
    }

    fn restore(&mut self, state: &[B::Scalar]) -> bool {
        self.factors.restore(state)
    }
}

impl<B: Backend, R: FactorRule> ScalarUpdate for Factored<B, R> {
    fn scalar_update(&mut self, h: &[B::Scalar], r: B::Scalar, gain: &mut [B::Scalar]) -> Result<(), BadPivot> {
        self.factors.measure_row(h, r, gain, R::updates::<B>())
    }
}

impl<B: Backend, R: FactorRule> Form for Factored<B, R> {
    const FACTS: FormFacts = FormFacts {
        factored: true,
        updates: update_flops::<R>,
        parameter_blocks: block_flops,
        // U D (U^T e) for the state that each output reads.
        output_columns: |size| {
            vec![Term { what: "columns of P from the factor", flops: 2.0 * size.p * size.triangle() }]
        },
    };
}

fn update_flops<R: FactorRule>(size: &StepSize) -> Vec<Term> {
    let (n, p, c) = (size.n, size.p, size.columns());
    vec![
        Term { what: "measurement update of the factor", flops: R::MEASUREMENT_FLOPS * p * size.triangle() },
        // p products for each of n^2 entries, and one with the entry of J, which is one or zero; U_x counts once.
        Term { what: "Abar on the states' rows", flops: 2.0 * (p + 1.0) * (c + 1.0) * n * n },
        // Column block t of U_theta has t blocks of rows: c (c + 1) / 2 blocks of n^2 entries.
        Term { what: "phi on U_theta", flops: c * (c + 1.0) * n * n },
        // The columns of the root are subtracted one after another from the remaining triangle.
        Term { what: "root of Qbar", flops: n * n * n / 3.0 },
        // The array is [Abar Ux, L] with L L^T = Qbar triangular: row j has n + n - j entries. Each row is eliminated
        // from the j rows above it, with a product and a subtraction for each entry.
        Term { what: "triangularisation", flops: R::TRIANGULARISATION_FLOPS * n * n * n },
    ]
}

/// Returns the operations of the sums of blocks. Weights = V V^T with V triangular: column k of V sums the blocks
/// k .. t of each column of block t. Then the squares are added up: n^2 for each column, or less in block k itself,
/// which is triangular.
fn block_flops(size: &StepSize, _pairs: f64) -> Vec<Term> {
    let (n, c) = (size.n, size.columns());
    vec![
        Term { what: "rows of the parameters' blocks", flops: c * (c + 1.0) * (c + 2.0) / 3.0 * n * n },
        Term { what: "sum of the parameters' blocks", flops: (c * (c - 1.0) / 2.0 + c / 3.0) * n * n * n },
    ]
}
