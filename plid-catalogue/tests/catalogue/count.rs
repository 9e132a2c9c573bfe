//! Every operation on a counted number counts once.
use plid_catalogue::count::{Counted, Operations, operations};
use plid_core::Scalar;
use plid_core::kernels::dot;

#[test]
fn every_operation_counts_once() {
    let (a, b) = (Counted(3.0), Counted(4.0));
    let (result, counted) = operations(|| (a.mul_add(a, b * b) - Counted(0.0)).sqrt() / -a);
    assert_eq!(result, Counted(-5.0 / 3.0));
    assert_eq!(counted, Operations { additions: 2, multiplications: 2, divisions: 1, roots: 1 });
    assert_eq!(counted.total(), 6);
}

#[test]
fn a_dot_product_has_as_many_products_as_entries() {
    let x = vec![Counted(1.0); 100];
    let (sum, counted) = operations(|| dot(&x, &x));
    assert_eq!((sum, counted.multiplications), (Counted(100.0), 100));
    assert!((100..=160).contains(&counted.additions), "{counted:?}");
}
