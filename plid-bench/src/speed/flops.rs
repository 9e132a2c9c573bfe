//! Where the operations of a step go: leading terms by form, expectation and n, p, m. What a report states is counted; the
//! tests hold these formulas to the count.
//!
//! N = (c + 1) n is the size of P, c = p + m the number of parameter columns, theta = c n. A multiplication and an addition are two
//! operations. Terms of lower order (of N p where there is N p^2, of n where there is n^2) are left out.

use plid_catalogue::{CovarianceName, ExpectationName};

use super::cell::{Cell, OUTPUTS};
use crate::Noise;

/// One part of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// What is done.
    pub what: &'static str,
    /// Its operations.
    pub flops: f64,
}

/// The parts of a cell's step.
pub fn terms(cell: &Cell) -> Vec<Term> {
    let size = Size::of(cell);
    let mut terms = match cell.variant.covariance {
        CovarianceName::Direct => symmetric(&size, 1.0),
        CovarianceName::Joseph => symmetric(&size, 2.0),
        CovarianceName::BiermanUd => factored(&size, Factor::Ud),
        CovarianceName::ArraySqrt => factored(&size, Factor::Array),
    };
    terms.extend(expectation(cell, &size));
    terms
}

/// n, p, m, c and N as numbers to calculate with.
struct Size {
    n: f64,
    p: f64,
    m: f64,
    c: f64,
    joint: f64,
}

impl Size {
    fn of(cell: &Cell) -> Self {
        let (n, p, m) = (cell.states as f64, OUTPUTS as f64, cell.inputs as f64);
        Self { n, p, m, c: p + m, joint: cell.joint_states() as f64 }
    }

    /// Entries of P's lower triangle.
    fn triangle(&self) -> f64 {
        self.joint * (self.joint + 1.0) / 2.0
    }
}

/// `corrections`: how many products of rank p the measurement update takes off P.
fn symmetric(size: &Size, corrections: f64) -> Vec<Term> {
    let &Size { n, p, c, joint, .. } = size;
    vec![
        // K = P H^T (L L^T)^-1: two triangular solves of p^2 operations for each of N rows.
        Term { what: "gain", flops: 2.0 * joint * p * p },
        // Each of them a product and a sum for every entry of the triangle and each of p columns; and its factor.
        Term {
            what: "measurement update of P",
            flops: corrections * (2.0 * p * size.triangle() + joint * p * (p + 1.0)),
        },
        // (K Re K^T)_ii for each of N variances.
        Term { what: "check of the variances", flops: joint * p * (p + 3.0) },
        // Abar P_xx Abar^T: p products for each of n^2 entries, and one with the one or zero of J, from either side; the same
        // from one side for P_{theta x}.
        Term { what: "Abar on the states' rows", flops: 2.0 * (p + 1.0) * (c + 2.0) * n * n },
        // (phi (x) I) P_{theta x}, twice: 2 c for each of n^2 entries.
        Term { what: "phi on P_{theta x}", flops: 4.0 * c * n * n },
        // P_{theta theta} (phi (x) I)^T: each entry of the lower triangle serves itself and its mirror image, whose sums are then added.
        Term { what: "phi on P_{theta theta}", flops: 2.0 * c * c * n * n + c * n * n },
    ]
}

enum Factor {
    Ud,
    Array,
}

fn factored(size: &Size, factor: Factor) -> Vec<Term> {
    let &Size { n, p, c, .. } = size;
    // The array is [Abar Ux, L] with L L^T = Qbar triangular: row j has n + n - j entries. Row after row is taken out of those above it, j
    // of them, a product and a subtraction for each entry.
    let (a_pass, triangularisation) = match factor {
        // Bierman's update changes an entry of U and one of the gain: 4. Gram-Schmidt goes over whole rows.
        Factor::Ud => (4.0, 8.0 / 3.0 * n * n * n),
        // A rotation changes both with 6. A reflection into L's own column leaves the rest of L alone: n entries.
        Factor::Array => (6.0, 2.0 * n * n * n),
    };
    vec![
        Term { what: "measurement update of the factor", flops: a_pass * p * size.triangle() },
        // As above; U_x once.
        Term { what: "Abar on the states' rows", flops: 2.0 * (p + 1.0) * (c + 1.0) * n * n },
        // Column block t of U_theta has t blocks of rows: c (c + 1) / 2 blocks of n^2 entries.
        Term { what: "phi on U_theta", flops: c * (c + 1.0) * n * n },
        // One column of the root after another is taken off the triangle that is left.
        Term { what: "root of Qbar", flops: n * n * n / 3.0 },
        Term { what: "triangularisation", flops: triangularisation },
    ]
}

/// What the expectation adds.
fn expectation(cell: &Cell, size: &Size) -> Vec<Term> {
    let &Size { n, p, m, c, .. } = size;
    // b_j (half b_j Q' + S')^T and its transpose for each input: a triangle each.
    let mut terms = vec![Term { what: "B Q' B^T", flops: 2.0 * m * n * n }];
    let expectations = cell.variant.expectations;
    if matches!(expectations, ExpectationName::JointEkf | ExpectationName::CertaintyEquivalent) {
        return terms;
    }
    // Pairs of parameter columns whose noises are correlated: each with itself, and each with others.
    let full = cell.noise == Noise::Full;
    let pairs = match expectations {
        // Given the measurement, the outputs' noises are correlated through P, and the inputs' with them through R.
        ExpectationName::MomentMatched if !full => p * (p - 1.0) / 2.0,
        _ if full => c * (c - 1.0) / 2.0,
        _ => 0.0,
    };
    match cell.variant.covariance {
        // A symmetric block has n (n + 1) / 2 entries that count; one beside the diagonal n^2, and the sum of those is added to its transpose.
        CovarianceName::Direct | CovarianceName::Joseph => {
            let mirrored = if pairs > 0.0 { n * n } else { 0.0 };
            terms.push(Term { what: "sum of the parameters' blocks", flops: (c + 2.0 * pairs) * n * n + mirrored });
        }
        // Weights = V V^T with V triangular: column k of V sums the blocks k .. t of each column of block t ..
        CovarianceName::BiermanUd | CovarianceName::ArraySqrt => {
            terms.push(Term { what: "rows of the parameters' blocks", flops: c * (c + 1.0) * (c + 2.0) / 3.0 * n * n });
            // .. of which the squares are added up: n^2 for each column, or less in block k itself, which is triangular.
            terms.push(Term {
                what: "sum of the parameters' blocks",
                flops: (c * (c - 1.0) / 2.0 + c / 3.0) * n * n * n,
            });
        }
    }
    if expectations == ExpectationName::MomentMatched {
        if matches!(cell.variant.covariance, CovarianceName::BiermanUd | CovarianceName::ArraySqrt) {
            // U D (U^T e) for the state that each output reads.
            terms.push(Term { what: "columns of P from the factor", flops: 2.0 * p * size.triangle() });
        }
        // E_ij E_ji^T for each pair of outputs: a triangle each.
        terms.push(Term { what: "products of the crossed covariances", flops: p * p * n * n });
    }
    terms
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::speed::cell::{EXPECTATIONS, FORMS};
    use crate::speed::count::count;
    use crate::{Record, Workload};

    const LESS: f64 = 0.01;

    /// The kernels of the factored forms fill whole registers, also beyond a matrix's edge or diagonal.
    fn more(form: CovarianceName) -> f64 {
        match form {
            CovarianceName::Direct | CovarianceName::Joseph => 0.05,
            CovarianceName::BiermanUd | CovarianceName::ArraySqrt => 0.25,
        }
    }

    #[test]
    fn formulas_are_what_is_counted() {
        let mut off = Vec::new();
        for (inputs, noise) in [(1, Noise::Diagonal), (3, Noise::Diagonal), (3, Noise::Full)] {
            let record = Record::truss(inputs, 0.01).unwrap();
            let workload = Workload::new(&record, 48, noise).unwrap();
            for (form, expectations) in FORMS.into_iter().flat_map(|f| EXPECTATIONS.map(|e| (f, e))) {
                let cell = Cell { inputs, noise, ..Cell::plain(48, form, expectations) };
                let counted = count(&cell, &workload).unwrap().total() as f64;
                let formula: f64 = terms(&cell).iter().map(|term| term.flops).sum();
                let ratio = counted / formula;
                if !(1.0 - LESS..1.0 + more(form)).contains(&ratio) {
                    off.push(format!("{ratio:.3} {}: {counted} for {formula}", cell.key()));
                }
            }
        }
        assert!(off.is_empty(), "{off:#?}");
    }
}
