//! All routines with motion along a route, against the enumeration of all paths.

use proptest::collection::vec;
use proptest::prelude::*;
use wayfix::transition::SwitchedTransition;
use wayfix::{Transition, TransitionEntries, TransitionError};
use wayfix_recognition::motion::{RouteControl, RouteTransition};

use super::definition::{Parts, control, parts};
use crate::kit::check_evidence;
use crate::kit::{Evidence, Model, NEVER, cases_of, matrix, weighted};

/// A route, and the measurements of one step.
#[derive(Debug, Clone)]
struct Step(RouteTransition, RouteControl);

impl Transition for Step {
    type Control = ();

    fn states(&self) -> usize {
        self.0.states()
    }

    fn apply(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.0.apply(&self.1, x, out);
    }

    fn apply_transpose(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.0.apply_transpose(&self.1, x, out);
    }

    fn apply_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.0.apply_log(&self.1, x, out);
    }

    fn apply_transpose_log(&self, (): &(), x: &[f64], out: &mut [f64]) {
        self.0.apply_transpose_log(&self.1, x, out);
    }

    fn evidence(&self, (): &()) -> Option<f64> {
        self.0.evidence(&self.1)
    }

    fn needs_logs(&self, (): &()) -> bool {
        self.0.needs_logs(&self.1)
    }

    fn check_control(&self, (): &()) -> Result<(), TransitionError> {
        self.0.check_control(&self.1)
    }
}

impl TransitionEntries for Step {
    fn incoming(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0.incoming(&self.1, to)
    }

    fn outgoing(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0.outgoing(&self.1, from)
    }

    fn incoming_log2(&self, (): &(), to: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0.incoming_log2(&self.1, to)
    }

    fn outgoing_log2(&self, (): &(), from: usize) -> impl Iterator<Item = (usize, f64)> {
        self.0.outgoing_log2(&self.1, from)
    }

    fn max_product(&self, (): &(), x: &[f64], out: &mut [f64], from: &mut [u32]) {
        self.0.max_product(&self.1, x, out, from);
    }
}

/// A drive of up to four steps.
fn drives() -> BoxedStrategy<(Parts, Vec<RouteControl>, Model)> {
    let parts = prop_oneof![parts(4, 1), parts(2, 2), parts(2, 3)];
    (parts, vec(control(), 1..=4), any::<bool>())
        .prop_flat_map(|(parts, controls, at_first)| {
            let n = parts.route().states();
            let log = prop_oneof![1 => Just(NEVER), 5 => (0.001..1.0).prop_map(f64::ln)];
            let shift = prop_oneof![5 => Just(0.0), 1 => Just(-1e5), 1 => Just(700.0)];
            let observed = (vec(log, n), shift)
                .prop_map(|(logs, shift)| logs.iter().map(|log| log + shift).collect::<Vec<f64>>());
            let observed = prop_oneof![1 => Just(None), 5 => observed.prop_map(Some)];
            let prior = weighted(prop_oneof![1 => Just(0.0), 3 => 0.01..1.0], n);
            let (parts, steps) = (parts.clone(), controls.len());
            (prior, vec(observed, steps)).prop_map(move |(prior, logs)| {
                let matrices = controls.iter().map(|u| parts.matrix(u)).collect();
                // Measurements are in the matrices already, except for the factor.
                let evidence = controls.iter().map(|u| {
                    let log_factor = parts.log_factor(u).unwrap_or(0.0);
                    Evidence { logs: matrix(n, |_, _| log_factor), log_factor }
                });
                let evidence = evidence.collect();
                let model = Model { states: n, at_first, prior, matrices, evidence, logs };
                (parts.clone(), controls.clone(), model)
            })
        })
        .boxed()
}

proptest! {
    #![proptest_config(cases_of(1000))]

    #[test]
    fn motion_along_a_route_equals_enumeration(
        (parts, controls, model) in drives(),
        of in (0..6_usize, 0..40_usize, any::<u64>()),
    ) {
        let steps = controls.iter().map(|control| Step(parts.route(), *control)).collect();
        check_evidence(&model, SwitchedTransition::new(steps).unwrap(), of)?;
    }
}
