//! Each law against mechanics, and each adjoint against central differences in f64.

use gic_simd::{Kernel, Lanes, Level, Real, dispatch};
use proptest::prelude::*;

use super::elastic::Elastic;
use super::law::*;
use super::newtonian::Newtonian;
use super::non_newtonian::NonNewtonian;
use super::plasticine::Plasticine;
use super::sand::Sand;
use super::viscoelastic::Viscoelastic;
use crate::math::eigen::Eigen;
use crate::math::mat3::Mat3;

const DT: f64 = 2e-4;
const MU: f64 = 4.0e5;
const LAMBDA: f64 = 6.0e5;
/// Yield limit on |e_hat| of plasticine here.
const PLASTICINE_LIMIT: f64 = 0.05;
const CONE: f64 = 0.386;
const NON_NEWTONIAN: Coefficients = Coefficients([1.0e4, 9.0e4, 600.0, 3.0]);

fn elastic(rules: Rules) -> Elastic<f64> {
    Elastic::new(&Coefficients([MU, LAMBDA, 0.0, 0.0]), rules)
}

/// Runs a generic check for each law, which gets the law's constructor and coefficients.
macro_rules! for_each_law {
    ($check:ident, $($argument:expr),*) => {
        $check::<Elastic<f64>>("elastic", Coefficients([MU, LAMBDA, 0.0, 0.0]), $($argument),*);
        $check::<Plasticine<f64>>("plasticine", plasticine_coefficients(), $($argument),*);
        $check::<Sand<f64>>("sand", Coefficients([MU, LAMBDA, CONE, 0.0]), $($argument),*);
        $check::<NonNewtonian<f64>>("non-newtonian", NON_NEWTONIAN, $($argument),*);
        $check::<Viscoelastic<f64>>("viscoelastic", Coefficients([MU, LAMBDA, 1.0e-3, 0.0]), $($argument),*);
        $check::<Newtonian<f64>>("newtonian", Coefficients([200.0, 1.0e5, 0.0, 0.0]), $($argument),*);
    };
}

fn plasticine_coefficients() -> Coefficients {
    Coefficients([MU, LAMBDA, 2.0 * MU * PLASTICINE_LIMIT, 0.0])
}

fn plasticine() -> Plasticine<f64> {
    Plasticine::new(&plasticine_coefficients(), Rules::Exact)
}

fn sand() -> Sand<f64> {
    Sand::new(&Coefficients([MU, LAMBDA, CONE, 0.0]), Rules::Exact)
}

fn non_newtonian() -> NonNewtonian<f64> {
    NonNewtonian::new(&NON_NEWTONIAN, Rules::Exact)
}

fn zero() -> Mat3<f64> {
    Mat3::zero()
}

/// A rotation by unit quaternion from three angles.
fn rotation([a, b, c]: [f64; 3]) -> Mat3<f64> {
    let q = glam::DQuat::from_euler(glam::EulerRot::XYZ, a, b, c);
    let m = glam::DMat3::from_quat(q);
    Mat3::from_fn(|i, j| m.col(j)[i])
}

/// `R1 diag(s) R2^T`.
fn with_stretches(s: [f64; 3]) -> Mat3<f64> {
    rotation([0.3, -1.1, 0.7]).times(&Mat3::diagonal(s)).times_transposed(&rotation([1.3, 0.4, -0.2]))
}

/// Deviator's length and trace of the principal Hencky strain.
fn hencky_strain(f: &Mat3<f64>) -> (f64, f64) {
    let log = Eigen::of_symmetric(&f.times_transposed(f)).values.map(|square| 0.5 * square.ln());
    let trace = log.iter().sum::<f64>();
    (log.iter().map(|e| (e - trace / 3.0).powi(2)).sum::<f64>().sqrt(), trace)
}

fn largest(m: &Mat3<f64>) -> f64 {
    m.0.iter().fold(0.0, |largest, x| x.abs().max(largest))
}

fn assert_close(a: &Mat3<f64>, b: &Mat3<f64>, tolerance: f64, what: &str) {
    let error = largest(&(*a - *b));
    assert!(error <= tolerance, "{what}: {a:?} against {b:?}, off by {error:e}");
}

// ---- The adjoints ----

/// Weights of the loss `w_f : F_new + w_tau : tau`, tau in units of mu.
#[derive(Clone, Copy, Debug)]
struct Weights {
    f: Mat3<f64>,
    tau: Mat3<f64>,
}

const WEIGHTS: Weights = Weights {
    f: Mat3([0.9, -0.4, 0.3, 0.7, -1.1, 0.5, -0.2, 0.6, 0.8]),
    tau: Mat3([-0.5, 0.8, 0.1, -0.9, 0.7, 1.2, 0.4, -0.3, 0.6]),
};

/// The largest error of a group of derivatives, relative to its largest member, or to `floor` where all are so small
/// that central differences see only rounding.
fn group_error(adjoint: &[f64], differences: &[f64], floor: f64) -> f64 {
    let scale = differences.iter().chain(adjoint).fold(floor, |s, d| s.max(d.abs()));
    let error = adjoint.iter().zip(differences).fold(0.0_f64, |e, (a, d)| e.max((a - d).abs()));
    error / scale
}

/// A fluid keeps only its volume: `diag(J, 1, 1)`.
fn state_of(name: &str, f: &Mat3<f64>) -> Mat3<f64> {
    if name == "newtonian" { Mat3::diagonal([f.det(), 1.0, 1.0]) } else { *f }
}

/// Compares the adjoint with central differences at one state, for the two outputs together and one at a time.
fn check_adjoint<L: Law<f64>>(
    name: &str,
    coefficients: Coefficients,
    rules: Rules,
    c: &Mat3<f64>,
    f: &Mat3<f64>,
    weights: Weights,
) {
    let f = &state_of(name, f);
    let unit = coefficients.0[0];
    for (f_weight, tau_weight) in [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0)] {
        let f_bar = weights.f * f_weight;
        let tau_bar = weights.tau * (tau_weight / unit);
        let loss = |coefficients: &Coefficients, c: &Mat3<f64>, f: &Mat3<f64>| {
            let new = L::new(coefficients, rules).update(DT, c, f);
            new.f.double_dot(&f_bar) + new.tau.double_dot(&tau_bar)
        };
        let adjoint = L::new(&coefficients, rules).update_adjoint(DT, c, f, &f_bar, &tau_bar);
        let moved = |m: &Mat3<f64>, i: usize, step: f64| {
            let mut m = *m;
            m.0[i] += step;
            m
        };
        let step = 1e-6;
        let mut found = [[0.0; 9]; 2];
        for i in 0..9 {
            let at = |s: f64| loss(&coefficients, &moved(c, i, s / DT), f);
            found[0][i] = (at(step) - at(-step)) / (2.0 * step / DT);
            let at = |s: f64| loss(&coefficients, c, &moved(f, i, s));
            found[1][i] = (at(step) - at(-step)) / (2.0 * step);
        }
        // The loss is of order one, rounded at 1e-16 and divided by a step of 1e-6.
        for (what, adjoint, found, floor) in
            [("C", adjoint.c.0, found[0], 1e-4 * DT), ("F", adjoint.f.0, found[1], 1e-4)]
        {
            let error = group_error(&adjoint, &found, floor);
            assert!(error <= 1e-5, "{name} {rules:?} d/d{what} at F {f:?}: {adjoint:?} against {found:?}, {error:e}");
        }
        for i in 0..MAX_COEFFICIENTS {
            let at = |s: f64| {
                let mut coefficients = coefficients;
                coefficients.0[i] *= 1.0 + s;
                loss(&coefficients, c, f)
            };
            // Logarithmic derivatives: what an optimiser of log parameters sees, and all of the size of the loss's
            // change.
            let found = (at(1e-5) - at(-1e-5)) / 2e-5;
            let adjoint = adjoint.coefficients[i] * coefficients.0[i];
            let error = group_error(&[adjoint], &[found], 1e-5);
            assert!(
                error <= 1e-5,
                "{name} {rules:?} coefficient {i} at F {f:?}: {adjoint:e} against {found:e}, {error:e}"
            );
        }
    }
}

fn check_adjoint_both_rules<L: Law<f64>>(name: &str, coefficients: Coefficients, c: &Mat3<f64>, f: &Mat3<f64>) {
    for rules in [Rules::Exact, Rules::Reference] {
        check_adjoint::<L>(name, coefficients, rules, c, f, WEIGHTS);
    }
}

/// A velocity gradient that strains by 1 % in a substep.
fn some_velocity_gradient() -> Mat3<f64> {
    Mat3([0.3, -0.2, 0.5, 0.1, -0.4, 0.6, -0.7, 0.2, 0.25]) * (0.01 / DT)
}

#[test]
fn adjoints_match_differences_at_rest() {
    let f = Mat3::identity();
    check_adjoint_both_rules::<Elastic<f64>>("elastic", Coefficients([MU, LAMBDA, 0.0, 0.0]), &zero(), &f);
    check_adjoint_both_rules::<Plasticine<f64>>("plasticine", plasticine_coefficients(), &zero(), &f);
    check_adjoint_both_rules::<NonNewtonian<f64>>("non-newtonian", NON_NEWTONIAN, &zero(), &f);
    check_adjoint_both_rules::<Newtonian<f64>>("newtonian", Coefficients([200.0, 1.0e5, 0.0, 0.0]), &zero(), &f);
}

#[test]
fn sand_at_the_tip_of_its_cone_differentiates_as_compressed() {
    // No derivative exists there; the one-sided one in a direction inside the cone is the elastic one.
    let law = sand();
    let direction = Mat3([-1.0, 0.02, 0.01, 0.0, -1.1, 0.03, -0.02, 0.0, -0.95]);
    let step = 1e-7;
    let moved = law.update(DT, &zero(), &Mat3::identity().add_scaled(step, &direction));
    let change = (moved.f - Mat3::identity()).double_dot(&WEIGHTS.f) + moved.tau.double_dot(&WEIGHTS.tau) / MU;
    let adjoint = law.update_adjoint(DT, &zero(), &Mat3::identity(), &WEIGHTS.f, &(WEIGHTS.tau * (1.0 / MU)));
    let found = change / step;
    assert!((adjoint.f.double_dot(&direction) - found).abs() <= 1e-5 * found.abs());
    assert!(adjoint.coefficients.iter().all(|bar| bar.is_finite()));
}

#[test]
fn adjoints_match_differences_at_coinciding_stretches() {
    for stretches in [
        // Compressed inside the cone, elastic: all equal; two equal; equal but for rounding.
        [0.9, 0.9, 0.9],
        [0.95, 0.95, 0.96],
        [0.95, 0.95 + 1e-9, 0.95 - 1e-12],
        // Yielding, two equal, in compression.
        [0.7, 0.7, 1.1],
        [1.2, 1.2 + 1e-10, 0.5],
        // Expanding.
        [1.1, 1.1, 1.1],
        [1.3, 1.3, 0.9],
        // On both sides of the switch from the series to the logarithm, x = 0.1.
        [0.8, 0.8 * 1.1054, 0.9],
        [0.8, 0.8 * 1.1056, 0.9],
    ] {
        let f = with_stretches(stretches);
        for_each_law!(check_adjoint_both_rules, &zero(), &f);
    }
}

#[test]
fn adjoints_match_differences_of_a_particle_in_motion() {
    let f = with_stretches([0.93, 0.95, 0.97]);
    for_each_law!(check_adjoint_both_rules, &some_velocity_gradient(), &f);
    let f = with_stretches([0.6, 0.9, 1.4]);
    for_each_law!(check_adjoint_both_rules, &some_velocity_gradient(), &f);
}

#[test]
fn adjoints_match_differences_on_both_sides_of_the_yield_surface() {
    let isochoric = |e: f64| with_stretches([e, 0.0, -e].map(f64::exp));
    let limit = PLASTICINE_LIMIT / 2.0_f64.sqrt();
    for e in [0.999 * limit, 1.001 * limit, 2.0 * limit] {
        check_adjoint_both_rules::<Plasticine<f64>>("plasticine", plasticine_coefficients(), &zero(), &isochoric(e));
    }
    let [mu, _, yield_stress, _] = NON_NEWTONIAN.0;
    let limit = (2.0_f64 / 3.0).sqrt() * yield_stress / (2.0 * mu) / 2.0_f64.sqrt();
    for e in [0.999 * limit, 1.001 * limit, 2.0 * limit] {
        check_adjoint_both_rules::<NonNewtonian<f64>>("non-newtonian", NON_NEWTONIAN, &zero(), &isochoric(e));
    }
    let trace = -0.06;
    let limit = -(1.0 + 1.5 * LAMBDA / MU) * trace * CONE / 2.0_f64.sqrt();
    for e in [0.999 * limit, 1.001 * limit, 2.0 * limit] {
        let f = with_stretches([e + trace / 3.0, trace / 3.0, trace / 3.0 - e].map(f64::exp));
        let coefficients = Coefficients([MU, LAMBDA, CONE, 0.0]);
        check_adjoint_both_rules::<Sand<f64>>("sand", coefficients, &zero(), &f);
    }
}

#[test]
fn adjoints_match_differences_where_stretches_are_raised() {
    for stretches in [[0.03, 0.9, 1.1], [0.03, 0.02, 1.1], [0.03, 0.03, 1.1], [0.03, 0.02, 0.06]] {
        let f = with_stretches(stretches);
        check_adjoint_both_rules::<Plasticine<f64>>("plasticine", plasticine_coefficients(), &zero(), &f);
        check_adjoint_both_rules::<Sand<f64>>("sand", Coefficients([MU, LAMBDA, CONE, 0.0]), &zero(), &f);
        check_adjoint_both_rules::<NonNewtonian<f64>>("non-newtonian", NON_NEWTONIAN, &zero(), &f);
    }
}

fn any_matrix() -> impl Strategy<Value = Mat3<f64>> {
    prop::array::uniform9(-1.0_f64..1.0).prop_map(Mat3)
}

/// Deformations by up to 20 % or so, not inverted.
fn any_deformation() -> impl Strategy<Value = Mat3<f64>> {
    (any_matrix(), -4.0_f64..-0.8).prop_map(|(m, size)| Mat3::identity().add_scaled(10.0_f64.powf(size), &m))
}

fn any_rotation() -> impl Strategy<Value = Mat3<f64>> {
    prop::array::uniform3(-3.0_f64..3.0).prop_map(rotation)
}

/// Whether a strain is so near to a kink of one of the maps that a difference could cross it.
fn near_a_kink(f_trial: &Mat3<f64>) -> bool {
    let (deviator, trace) = hencky_strain(f_trial);
    let [mu, _, yield_stress, _] = NON_NEWTONIAN.0;
    let cone = -(1.0 + 1.5 * LAMBDA / MU) * trace * CONE;
    let non_newtonian = (2.0_f64 / 3.0).sqrt() * yield_stress / (2.0 * mu);
    let kinks = [deviator - PLASTICINE_LIMIT, deviator - non_newtonian, deviator - cone, trace];
    // The rules' norms differ by up to 1e-4, and a step is 1e-6.
    kinks.iter().any(|distance| distance.abs() < 2e-4)
}

proptest! {
    #[test]
    fn adjoints_match_differences_anywhere(
        f in any_deformation(), c in any_matrix(), w_f in any_matrix(), w_tau in any_matrix(),
    ) {
        let c = c * (0.02 / DT);
        prop_assume!(!near_a_kink(&trial(DT, &c, &f)));
        let weights = Weights { f: w_f, tau: w_tau };
        for_each_law!(check_adjoint, Rules::Exact, &c, &f, weights);
    }
}

// ---- Mechanics ----

fn check_rest<L: Law<f64>>(name: &str, coefficients: Coefficients) {
    for rules in [Rules::Exact, Rules::Reference] {
        let new = L::new(&coefficients, rules).update(DT, &zero(), &Mat3::identity());
        assert_eq!(new.f.0, Mat3::<f64>::identity().0, "{name}");
        assert!(largest(&new.tau) <= 1e-9, "{name}: {:?}", new.tau);
    }
}

#[test]
fn rest_is_free_of_stress_and_stays() {
    for_each_law!(check_rest,);
}

#[test]
fn small_strains_follow_hookes_law() {
    let e = Mat3([2.0, 0.7, -0.3, 0.7, -1.5, 0.4, -0.3, 0.4, -1.0]) * 1e-6;
    let f = Mat3::identity() + e;
    let hooke = (e * (2.0 * MU)).add_diagonal(LAMBDA * e.trace());
    assert_close(&elastic(Rules::Exact).update(DT, &zero(), &f).tau, &hooke, 1e-4 * MU * 1e-6, "neo-Hookean");
    assert_close(&plasticine().update(DT, &zero(), &f).tau, &hooke, 1e-4 * MU * 1e-6, "Hencky");
}

#[test]
fn a_viscoelastic_solid_is_delayed_in_shear_and_compression_alike() {
    let law = Viscoelastic::<f64>::new(&Coefficients([MU, LAMBDA, 0.5, 0.0]), Rules::Exact);
    let rate = Mat3([2.0, 0.7, -0.3, 0.1, -1.5, 0.4, 0.5, -0.4, -1.0]);
    let strain = rate.symmetric_part() * 0.5;
    let hooke = (strain * (2.0 * MU)).add_diagonal(LAMBDA * strain.trace());
    let tau = law.update(1e-12, &rate, &Mat3::identity()).tau;
    assert_close(&tau, &hooke, 1e-9 * MU, "half a second of strain");
}

#[test]
fn uniaxial_hencky_stress_is_linear_in_the_logarithmic_strain() {
    let (e, nu) = (0.02_f64, LAMBDA / (2.0 * (LAMBDA + MU)));
    let young = MU * (3.0 * LAMBDA + 2.0 * MU) / (LAMBDA + MU);
    let f = Mat3::diagonal([e, -nu * e, -nu * e].map(f64::exp));
    let tau = plasticine().update(DT, &zero(), &f).tau;
    assert_close(&tau, &Mat3::diagonal([young * e, 0.0, 0.0]), 1e-9 * young, "uniaxial stress");
}

#[test]
fn a_fluid_resists_by_pressure_and_viscosity() {
    let law = Newtonian::<f64>::new(&Coefficients([200.0, 1.0e5 - 400.0 / 3.0, 0.0, 0.0]), Rules::Exact);
    let shear = Mat3([0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let tau = law.update(DT, &shear, &Mat3::identity()).tau;
    assert_close(&tau, &(shear.plus_transpose() * 100.0), 1e-9, "simple shear");
    let compression = law.update(DT, &Mat3::diagonal([-1.0, -2.0, -3.0]), &Mat3::identity());
    let j = 1.0 - 6.0 * DT;
    assert!((compression.f.det() - j).abs() < 1e-15);
    let pressure_only = (compression.tau.trace() - 200.0 * j * -6.0) / 3.0;
    assert!((pressure_only - 1.0e5 * (j - j.powi(-6))).abs() < 1e-6);
}

#[test]
fn plastic_flow_keeps_the_volume() {
    let f = with_stretches([0.6, 1.1, 1.7]);
    for new in [plasticine().update(DT, &zero(), &f), non_newtonian().update(DT, &zero(), &f)] {
        assert!((new.f.det() - f.det()).abs() < 1e-12);
        assert!(largest(&(new.f - f)) > 1e-3, "it must have flowed");
    }
}

#[test]
fn sand_in_expansion_carries_nothing() {
    let new = sand().update(DT, &zero(), &with_stretches([0.9, 1.1, 1.3]));
    assert!(largest(&new.tau) < 1e-9);
    assert_close(&new.f.times_transposed(&new.f), &Mat3::identity(), 1e-13, "only the rotation is left");
}

#[test]
fn viscosity_delays_the_return() {
    let f = with_stretches([0.9, 1.0, 1.1]);
    let excess = |eta: f64| {
        let mut coefficients = NON_NEWTONIAN;
        coefficients.0[3] = eta;
        let law = NonNewtonian::<f64>::new(&coefficients, Rules::Exact);
        let (deviator, _) = hencky_strain(&law.update(DT, &zero(), &f).f);
        let [mu, _, yield_stress, _] = NON_NEWTONIAN.0;
        2.0 * mu * deviator - (2.0_f64 / 3.0).sqrt() * yield_stress
    };
    assert!(excess(0.0).abs() < 1e-8, "without viscosity the return is instant");
    let before = 2.0 * NON_NEWTONIAN.0[0] * hencky_strain(&f).0 - (2.0_f64 / 3.0).sqrt() * NON_NEWTONIAN.0[2];
    let q = 2.0 * NON_NEWTONIAN.0[0] * f.double_dot(&f) / 3.0 * DT;
    assert!((excess(q) - before / 2.0).abs() < 1e-8 * before, "eta = q takes back half of the excess");
}

#[test]
fn crushed_and_inverted_particles_are_pushed_back() {
    for stretches in [[1e-3, 1.0, 1.0], [-0.3, 1.0, 1.0], [0.0, 1.0, 1.0]] {
        let f = Mat3::diagonal(stretches);
        let elastic = elastic(Rules::Exact).update(DT, &zero(), &f);
        assert!(elastic.tau.at(0, 0) < -LAMBDA, "{:?}", elastic.tau);
        for new in [plasticine().update(DT, &zero(), &f), sand().update(DT, &zero(), &f)] {
            assert!(new.tau.0.iter().chain(&new.f.0).all(|x| x.is_finite()), "{stretches:?}: {new:?}");
            assert!(new.tau.trace() < 0.0);
            if stretches[0] != 0.0 {
                assert!(new.f.det() > 0.0, "{stretches:?} became {:?}", new.f);
            }
        }
    }
}

/// Rotating the world rotates the stress; rotating the body before deforming it changes nothing.
fn check_objectivity<L: Law<f64>>(name: &str, coefficients: Coefficients, q: &Mat3<f64>, c: &Mat3<f64>, f: &Mat3<f64>) {
    let law = L::new(&coefficients, Rules::Exact);
    let turned_c = q.times(c).times_transposed(q);
    let f = &state_of(name, f);
    let is_fluid = name == "newtonian";
    let plain = law.update(DT, c, f);
    let turned_f = if is_fluid { *f } else { q.times(f) };
    let turned = law.update(DT, &turned_c, &turned_f);
    let tolerance = 1e-11 * coefficients.0[1];
    assert_close(&turned.tau, &q.times(&plain.tau).times_transposed(q), tolerance, name);
    if !is_fluid {
        assert_close(&turned.f, &q.times(&plain.f), 1e-11, name);
        let before = law.update(DT, c, &f.times(q));
        assert_close(&before.tau, &plain.tau, tolerance, name);
        assert_close(&before.f, &plain.f.times(q), 1e-11, name);
    }
}

proptest! {
    #[test]
    fn laws_are_objective_and_isotropic(q in any_rotation(), c in any_matrix(), f in any_deformation()) {
        for_each_law!(check_objectivity, &q, &(c * (0.02 / DT)), &f);
    }

    #[test]
    fn stress_after_the_return_map_is_admissible(c in any_matrix(), f in any_deformation()) {
        let c = c * (0.02 / DT);
        let (deviator, _) = hencky_strain(&plasticine().update(DT, &c, &f).f);
        prop_assert!(deviator <= PLASTICINE_LIMIT * (1.0 + 1e-11));
        let (deviator, trace) = hencky_strain(&sand().update(DT, &c, &f).f);
        let limit = -(1.0 + 1.5 * LAMBDA / MU) * trace * CONE;
        prop_assert!(trace <= 1e-13 && deviator <= limit.max(0.0) + 1e-13, "{deviator} {limit} {trace}");
    }

    #[test]
    fn return_maps_are_idempotent(f in any_deformation()) {
        type Return<'a> = &'a dyn Fn(&Mat3<f64>) -> Updated<f64>;
        let maps: [(&str, Return<'_>); 2] = [
            ("plasticine", &|f| plasticine().update(DT, &zero(), f)),
            ("sand", &|f| sand().update(DT, &zero(), f)),
        ];
        for (name, map) in maps {
            let once = map(&f);
            let again = map(&once.f);
            assert_close(&again.f, &once.f, 1e-12, name);
            assert_close(&again.tau, &once.tau, 1e-12 * LAMBDA, name);
        }
    }

    #[test]
    fn elastic_states_are_untouched_to_the_last_bit(m in any_matrix()) {
        // Strains of 0.1 % in a material that yields at 5 %.
        let f = Mat3::identity().add_scaled(1e-3, &m);
        prop_assert_eq!(plasticine().update(DT, &zero(), &f).f.0, f.0);
    }

    #[test]
    fn the_reference_rules_differ_by_less_than_their_norm_floor(f in any_deformation()) {
        let exact = plasticine().update(DT, &zero(), &f);
        let reference = Plasticine::<f64>::new(&plasticine_coefficients(), Rules::Reference).update(DT, &zero(), &f);
        // sqrt(x.x + 1e-8) - |x| <= 1e-8 / (2 |x|), and it only yields near |x| = 0.05.
        assert_close(&exact.f, &reference.f, 3e-7, "Exact against Reference");
    }
}

// ---- Lanes ----

/// Runs a law and its adjoint on the same particle in each lane; gives (F_new, tau / mu, F_bar, C_bar / dt, coefficient
/// bars * coefficient).
struct InLanes<'a> {
    coefficients: Coefficients,
    material: &'a str,
    c: Mat3<f64>,
    f: Mat3<f64>,
}

impl InLanes<'_> {
    #[inline(always)]
    fn evaluate<R: Real, L: Law<R>>(&self) -> Vec<f64> {
        let lanes = |m: &Mat3<f64>| Mat3(m.0.map(R::splat));
        let mu = self.coefficients.0[0];
        let law = L::new(&self.coefficients, Rules::Exact);
        let (dt, c, f) = (R::splat(DT), lanes(&self.c), lanes(&self.f));
        let new = law.update(dt, &c, &f);
        let bar = law.update_adjoint(dt, &c, &f, &lanes(&WEIGHTS.f), &lanes(&(WEIGHTS.tau * (1.0 / mu))));
        // The last lane: the others are alike.
        let number = |x: &R| x.lane(R::LANES - 1);
        let mut all: Vec<f64> = new.f.0.iter().map(number).collect();
        all.extend(new.tau.0.iter().map(|x| number(x) / mu));
        all.extend(bar.f.0.iter().map(number));
        all.extend(bar.c.0.iter().map(|x| number(x) / DT));
        all.extend(bar.coefficients.iter().zip(self.coefficients.0).map(|(bar, c)| number(bar) * c));
        all
    }

    #[inline(always)]
    fn by_name<R: Real>(&self) -> Vec<f64> {
        match self.material {
            "elastic" => self.evaluate::<R, Elastic<R>>(),
            "plasticine" => self.evaluate::<R, Plasticine<R>>(),
            "sand" => self.evaluate::<R, Sand<R>>(),
            "non-newtonian" => self.evaluate::<R, NonNewtonian<R>>(),
            "viscoelastic" => self.evaluate::<R, Viscoelastic<R>>(),
            _ => self.evaluate::<R, Newtonian<R>>(),
        }
    }
}

impl Kernel for &InLanes<'_> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> Vec<f64> {
        self.by_name::<L>()
    }
}

fn check_lanes<L: Law<f64>>(name: &str, coefficients: Coefficients, c: &Mat3<f64>, f: &Mat3<f64>) {
    let particle = InLanes { coefficients, material: name, c: *c, f: state_of(name, f) };
    let exact = particle.by_name::<f64>();
    let scale = exact.iter().fold(1.0_f64, |s, x| s.max(x.abs()));
    let check = |what: &str, found: Vec<f64>| {
        for (i, (found, exact)) in found.iter().zip(&exact).enumerate() {
            // Rounding of F to f32 alone moves strains by 1e-7.
            assert!(
                (found - exact).abs() <= 5e-6 * scale,
                "{name} {what}, output {i} at F {f:?}: {found} against {exact}"
            );
        }
    };
    check("plain f32", particle.by_name::<f32>());
    Level::supported().for_each(|level| check(&level.to_string(), dispatch(level, &particle)));
}

#[test]
fn lanes_agree_with_f64_also_where_stretches_coincide() {
    let mut states = vec![Mat3::identity()];
    states.extend(
        [[0.9, 0.9, 0.9], [0.95, 0.95, 0.951], [0.7, 0.7, 1.1], [1.2, 1.2001, 0.5], [0.6, 0.9, 1.4]]
            .map(with_stretches),
    );
    states.extend([1e-3, 1e-4, 1e-5].map(|size| Mat3::identity() - (with_stretches([1.0, 1.1, 1.3]) * size)));
    for f in &states {
        for_each_law!(check_lanes, &(some_velocity_gradient() * 0.1), f);
    }
}
