//! Every operation, at every level that this machine has, against plain numbers.

use gic_simd::{Kernel, Lanes, Level, MAX_LANES, Real, dispatch, oracle};
use proptest::prelude::*;

/// Applies an operation on three lanes' worth of numbers.
struct Apply<F>(F, [[f32; MAX_LANES]; 3]);

/// An operation written over any lanes; plain `fn` items cannot be generic over a later type, so it is a trait.
trait Operation {
    fn apply<R: Real>(&self, a: R, b: R, c: R) -> R;
}

impl<F: Operation> Kernel for Apply<F> {
    type Output = (Vec<f32>, usize);
    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> Self::Output {
        let [a, b, c] = self.1.map(|row| L::load(&row));
        let mut out = [0.0; MAX_LANES];
        self.0.apply(a, b, c).store(&mut out);
        (out[..L::LANES].to_vec(), L::LANES)
    }
}

macro_rules! operation {
    ($name:ident, |$a:ident, $b:ident, $c:ident| $body:expr) => {
        #[derive(Clone, Copy)]
        struct $name;
        impl Operation for $name {
            #[inline(always)]
            fn apply<R: Real>(&self, $a: R, $b: R, $c: R) -> R {
                $body
            }
        }
    };
}

operation!(Arithmetic, |a, b, c| (a + b) * c - a / b);
operation!(Negation, |a, _b, _c| -a);
operation!(AbsoluteRoot, |a, _b, _c| a.abs().sqrt());
operation!(Minimum, |a, b, _c| a.min(b));
operation!(Maximum, |a, b, _c| a.max(b));
operation!(Floor, |a, _b, _c| a.floor());
operation!(CopySign, |a, b, _c| a.copysign(b));
operation!(SelectLess, |a, b, c| R::select(a.lt(b), c, -c));
operation!(SelectLessEqual, |a, b, c| R::select(a.le(b), c, -c));
operation!(SelectAnd, |a, b, c| R::select(R::and(a.lt(b), b.lt(c)), a, c));
operation!(SelectOr, |a, b, c| R::select(R::or(a.lt(b), b.lt(c)), a, c));
operation!(SelectNot, |a, b, c| R::select(R::not(a.lt(b)), a, c));
operation!(Fused, |a, b, c| a.mul_add(b, c));
operation!(Exponential, |a, _b, _c| a.exp());
operation!(Logarithm, |a, _b, _c| a.ln());
operation!(Reciprocal, |a, _b, _c| a.recip());
operation!(ReciprocalRoot, |a, _b, _c| a.rsqrt());

/// Runs at every level; `check(level, lane's inputs, lane's result, plain f32 result)`.
fn at_all_levels<F: Operation + Copy>(f: F, rows: [[f32; MAX_LANES]; 3], check: impl Fn(Level, [f32; 3], f32, f32)) {
    for level in Level::supported() {
        let (out, lanes) = dispatch(level, Apply(f, rows));
        for i in 0..lanes {
            let inputs = [rows[0][i], rows[1][i], rows[2][i]];
            check(level, inputs, out[i], f.apply(inputs[0], inputs[1], inputs[2]));
        }
    }
}

fn identical<F: Operation + Copy>(f: F, rows: [[f32; MAX_LANES]; 3]) {
    at_all_levels(f, rows, |level, inputs, lane, plain| {
        let same = lane.to_bits() == plain.to_bits() || (lane.is_nan() && plain.is_nan());
        assert!(same, "{level} {inputs:?}: {lane} against {plain}");
    });
}

/// The distance between two numbers in units of the last place of the second.
fn ulps(found: f32, exact: f64) -> f64 {
    let nearest = exact as f32;
    let ulp = f64::from(nearest.next_up()) - f64::from(nearest);
    (f64::from(found) - exact).abs() / ulp.abs()
}

fn any_number() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -1.0e3_f32..1.0e3,
        4 => any::<f32>(),
        1 => prop::sample::select(vec![0.0, -0.0, 1.0, -1.0, 0.5, f32::INFINITY, f32::NEG_INFINITY, f32::NAN]),
    ]
}

fn any_rows() -> impl Strategy<Value = [[f32; MAX_LANES]; 3]> {
    prop::array::uniform3(prop::array::uniform16(any_number()))
}

proptest! {
    #[test]
    fn exact_operations_agree_bit_for_bit_with_plain_numbers(rows in any_rows()) {
        identical(Arithmetic, rows);
        identical(Negation, rows);
        identical(AbsoluteRoot, rows);
        identical(Minimum, rows);
        identical(Maximum, rows);
        identical(Floor, rows);
        identical(CopySign, rows);
        identical(SelectLess, rows);
        identical(SelectLessEqual, rows);
        identical(SelectAnd, rows);
        identical(SelectOr, rows);
        identical(SelectNot, rows);
    }

    #[test]
    fn the_fused_product_is_at_least_as_good_as_two_roundings(
        rows in prop::array::uniform3(prop::array::uniform16(-1.0e3_f32..1.0e3)),
    ) {
        at_all_levels(Fused, rows, |level, [a, b, c], lane, _plain| {
            let [a, b, c] = [a, b, c].map(f64::from);
            let bound = f64::from(f32::EPSILON) * ((a * b).abs() + c.abs());
            assert!((f64::from(lane) - a.mul_add(b, c)).abs() <= bound, "{level} {a} {b} {c}: {lane}");
        });
    }
}

/// Feeds many numbers through one operation, 16 at a time.
fn sweep(f: impl Operation + Copy, numbers: impl IntoIterator<Item = f32>, check: impl Fn(Level, f32, f32)) {
    let numbers: Vec<f32> = numbers.into_iter().collect();
    for chunk in numbers.chunks(4) {
        // Every level has at least four lanes; the wider ones repeat the numbers.
        let mut row = [chunk[0]; MAX_LANES];
        for i in 0..MAX_LANES {
            row[i] = chunk[i % chunk.len()];
        }
        at_all_levels(f, [row; 3], |level, [x, ..], lane, _| check(level, x, lane));
    }
}

/// Numbers from `from` to `to`, closer and closer to zero from both sides.
fn graded(from: f32, to: f32) -> impl Iterator<Item = f32> {
    let steps = 40_000;
    let even = (0..=steps).map(move |i| from + (to - from) * (i as f32 / steps as f32));
    let tiny = (-60..0).flat_map(|e| [-1.5, -1.0, 1.0, 1.37].map(|m: f32| m * 2.0_f32.powi(e)));
    even.chain(tiny.filter(move |x| (from..=to).contains(x)))
}

#[test]
fn exponential_is_within_two_ulp() {
    sweep(Exponential, graded(-87.0, 88.0), |level, x, found| {
        let error = ulps(found, f64::from(x).exp());
        assert!(error <= 2.0, "{level}: exp({x}) = {found} is off by {error} ulp");
    });
}

#[test]
fn logarithm_is_within_two_ulp() {
    let all_binades = (-126..128).flat_map(|e| (0..200).map(move |i| (1.0 + i as f32 / 200.0) * 2.0_f32.powi(e)));
    let near_one = graded(-0.6, 1.2).map(|x| 1.0 + x);
    sweep(Logarithm, all_binades.chain(near_one), |level, x, found| {
        let exact = f64::from(x).ln();
        let good = if exact == 0.0 { found == 0.0 } else { ulps(found, exact) <= 2.0 };
        assert!(good, "{level}: ln({x}) = {found}, not {exact}");
    });
}

#[test]
fn reciprocals_are_within_their_bounds() {
    let numbers = (-100..100).flat_map(|e| (0..100).map(move |i| (1.0 + i as f32 / 100.0) * 2.0_f32.powi(e)));
    sweep(Reciprocal, numbers.clone(), |level, x, found| {
        assert!(ulps(found, 1.0 / f64::from(x)) <= 2.0, "{level}: 1/{x} = {found}");
    });
    sweep(ReciprocalRoot, numbers, |level, x, found| {
        assert!(ulps(found, 1.0 / f64::from(x).sqrt()) <= 3.0, "{level}: 1/sqrt({x}) = {found}");
    });
}

#[test]
fn a_number_that_is_none_never_becomes_one() {
    sweep(Exponential, [f32::NAN], |level, _, found| assert!(found.is_nan(), "{level}: exp(NaN) = {found}"));
    sweep(Logarithm, [f32::NAN, -1.0, f32::NEG_INFINITY], |level, x, found| {
        assert!(found.is_nan(), "{level}: ln({x}) = {found}");
    });
    sweep(Logarithm, [0.0], |level, x, found| assert!(!found.is_finite(), "{level}: ln({x}) = {found}"));
}

#[test]
fn exponential_stays_finite_and_positive_beyond_its_range() {
    sweep(Exponential, [-1000.0, -200.0, 88.0], |level, x, found| {
        assert!(found.is_finite() && (x > 0.0 || found < 1e-37), "{level}: exp({x}) = {found}");
    });
}

struct Shapes;

impl Kernel for Shapes {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) {
        check_shapes::<L>();
    }
}

impl Kernel<f64> for Shapes {
    type Output = ();
    fn run<L: Lanes<Scalar = f64>>(self) {
        check_shapes::<L>();
    }
}

fn numbers<L: Lanes>(values: L) -> Vec<f64> {
    (0..L::LANES).map(|i| values.lane(i)).collect()
}

/// Row k of a block: 100 k + lane.
fn row<L: Lanes>(k: usize) -> L {
    L::lane_index() + L::splat(100.0 * k as f64)
}

fn check_shapes<L: Lanes>() {
    assert!(L::LANES <= MAX_LANES && L::GROUPS * 4 == L::LANES);
    let lanes = || 0..L::LANES;
    assert_eq!(numbers(L::lane_index()), lanes().map(|i| i as f64).collect::<Vec<_>>());
    assert_eq!(numbers(L::group_index()), lanes().map(|i| (i / 4) as f64).collect::<Vec<_>>());
    assert_eq!(L::lane_index().sum_lanes(), lanes().sum::<usize>() as f64);

    let four = [3.0, 5.0, 7.0, 11.0];
    let quad = four.map(gic_simd::Scalar::from_f64);
    // SAFETY: the array has four numbers.
    let everywhere = unsafe { L::quad_at(quad.as_ptr()) };
    assert_eq!(numbers(everywhere), lanes().map(|i| four[i % 4]).collect::<Vec<_>>());
    assert_eq!(numbers(L::spread(&quad)), lanes().map(|i| four[i / 4]).collect::<Vec<_>>());
    let table: Vec<L::Scalar> = (0..64).map(|i| gic_simd::Scalar::from_f64(f64::from(i))).collect();
    // SAFETY: the last of at most four groups ends at 1 + 3 * 17 + 4 <= 64.
    let strided = unsafe { L::strided_quads_at(table.as_ptr().add(1), 17) };
    assert_eq!(numbers(strided), lanes().map(|i| (1 + i / 4 * 17 + i % 4) as f64).collect::<Vec<_>>());

    let rows = [0, 1, 2, 3].map(row::<L>);
    let turned = L::transpose(rows);
    for q in 0..4 {
        let expected: Vec<f64> = lanes().map(|i| 100.0 * (i % 4) as f64 + (i / 4 * 4 + q) as f64).collect();
        assert_eq!(numbers(turned[q]), expected);
    }
    let back = L::transpose(turned);
    assert!((0..4).all(|k| numbers(back[k]) == numbers(rows[k])));

    let mut sums = [L::Scalar::default(); 16];
    // SAFETY: the array has room for 16 numbers.
    unsafe { L::store_group_sums_at(rows, sums.as_mut_ptr()) };
    for i in 0..16 {
        let (k, element) = (i / 4, i % 4);
        let expected: f64 = (0..L::GROUPS).map(|g| (100 * k + 4 * g + element) as f64).sum();
        assert_eq!(gic_simd::Scalar::to_f64(sums[i]), expected);
    }

    let bits = L::bits(L::lane_index().lt(L::splat(3.0)));
    assert_eq!(bits, 0b111);
    assert!(L::any(L::lane_index().lt(L::splat(1.0))) && !L::any(L::lane_index().lt(L::zero())));

    let three = [quad[0], quad[1], quad[2]];
    let partial = L::load_partial(&three, quad[3]);
    assert_eq!(numbers(partial), lanes().map(|i| if i < 3 { four[i] } else { four[3] }).collect::<Vec<_>>());
    let mut short = [L::Scalar::default(); 2];
    partial.store_partial(&mut short);
    assert_eq!(short.map(gic_simd::Scalar::to_f64), [3.0, 5.0]);
}

#[test]
fn groups_and_memory_are_laid_out_alike_at_every_level() {
    Level::supported().for_each(|level| dispatch(level, Shapes));
    oracle(Shapes);
}

struct LoadShort;

impl Kernel for LoadShort {
    type Output = f64;
    fn run<L: Lanes<Scalar = f32>>(self) -> f64 {
        L::load(&[0.0; 3]).sum_lanes()
    }
}

#[test]
#[should_panic(expected = "shorter than the lanes")]
fn a_slice_that_is_too_short_is_caught() {
    dispatch(Level::Scalar, LoadShort);
}
