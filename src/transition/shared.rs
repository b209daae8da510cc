//! Delegation of the methods of an operator to an inner one, for pointers and wrappers.
//!
//! A trait's default must never stand in for a method that the inner operator overrides: results
//! would stay right, but a fast path or a check would be lost. So the groups below keep methods
//! together that belong together.

use std::rc::Rc;
use std::sync::Arc;

use super::{Transition, TransitionEntries};
use crate::fixed::Fixed;

/// Implements the named methods of [`Transition`], [`TransitionEntries`] and
/// [`LearnTransition`](super::LearnTransition) by those of an inner operator, with its control:
/// `delegate!(a, control => a.inner, control; states evidence)`.
macro_rules! delegate {
    // One internal rule for each name. `$a` and `$u` come from the caller, since identifiers of a
    // macro are invisible to the expressions `$inner` and `$control`.
    ($a:ident, $u:ident => $inner:expr, $control:expr; $($method:ident)+) => {
        $($crate::transition::delegate!(@$method $a, $u => $inner, $control);)+
    };
    (@product $name:ident $a:ident, $u:ident => $inner:expr, $control:expr) => {
        fn $name(&self, $u: &Self::Control, x: &[f64], out: &mut [f64]) {
            let $a = self;
            $inner.$name($control, x, out);
        }
    };
    (@entries $name:ident $a:ident, $u:ident => $inner:expr, $control:expr) => {
        fn $name(
            &self,
            $u: &Self::Control,
            state: usize,
        ) -> impl Iterator<Item = (usize, f64)> {
            let $a = self;
            $inner.$name($control, state)
        }
    };
    (@of_control $name:ident -> $type:ty, $a:ident, $u:ident => $inner:expr, $control:expr) => {
        fn $name(&self, $u: &Self::Control) -> $type {
            let $a = self;
            $inner.$name($control)
        }
    };
    (@states $a:ident, $u:ident => $inner:expr, $control:expr) => {
        fn states(&self) -> usize {
            let $a = self;
            $inner.states()
        }
    };
    (@has_restarts $a:ident, $u:ident => $inner:expr, $control:expr) => {
        fn has_restarts(&self) -> bool {
            let $a = self;
            $inner.has_restarts()
        }
    };
    (@products $($rest:tt)+) => {
        $crate::transition::delegate!(@product apply $($rest)+);
        $crate::transition::delegate!(@product apply_transpose $($rest)+);
        $crate::transition::delegate!(@product apply_log $($rest)+);
        $crate::transition::delegate!(@product apply_transpose_log $($rest)+);
    };
    // Two methods that go together: `smallest_entry` decides whether `apply_in_blocks` is called.
    (@blocks $a:ident, $u:ident => $inner:expr, $control:expr) => {
        fn apply_in_blocks(
            &self,
            $u: &Self::Control,
            x: &[f64],
            take: &mut dyn FnMut(usize, &[f64]),
        ) {
            let $a = self;
            $inner.apply_in_blocks($control, x, take);
        }

        fn smallest_entry(&self, $u: &Self::Control) -> f64 {
            let $a = self;
            $inner.smallest_entry($control)
        }
    };
    (@evidence $($rest:tt)+) => {
        $crate::transition::delegate!(@of_control evidence -> Option<f64>, $($rest)+);
    };
    (@needs_logs $($rest:tt)+) => {
        $crate::transition::delegate!(@of_control needs_logs -> bool, $($rest)+);
    };
    (@stored $($rest:tt)+) => {
        $crate::transition::delegate!(
            @of_control stored -> Option<$crate::transition::Stored<'_>>, $($rest)+
        );
    };
    (@check_control $($rest:tt)+) => {
        $crate::transition::delegate!(
            @of_control check_control -> Result<(), $crate::error::TransitionError>, $($rest)+
        );
    };
    (@all_entries $a:ident, $u:ident => $inner:expr, $control:expr) => {
        $crate::transition::delegate!(@entries incoming $a, $u => $inner, $control);
        $crate::transition::delegate!(@entries outgoing $a, $u => $inner, $control);
        $crate::transition::delegate!(@entries incoming_log2 $a, $u => $inner, $control);
        $crate::transition::delegate!(@entries outgoing_log2 $a, $u => $inner, $control);
        $crate::transition::delegate!(
            @of_control entries_need_logs -> bool, $a, $u => $inner, $control
        );

        fn max_product(&self, $u: &Self::Control, x: &[f64], out: &mut [f64], from: &mut [u32]) {
            let $a = self;
            $inner.max_product($control, x, out, from);
        }
    };
    (@statistics $a:ident, $u:ident => $inner:expr, $control:expr) => {
        fn statistics(&self) -> Self::Statistics {
            let $a = self;
            $inner.statistics()
        }

        fn merge(&self, statistics: &mut Self::Statistics, other: &Self::Statistics) {
            let $a = self;
            $inner.merge(statistics, other);
        }

        fn counts<'s>(
            &self,
            statistics: &'s mut Self::Statistics,
            $u: &Self::Control,
        ) -> Option<&'s mut $crate::transition::MoveCounts> {
            let $a = self;
            $inner.counts(statistics, $control)
        }
    };
    (@parameters $a:ident, $u:ident => $inner:expr, $control:expr) => {
        fn log_prior(&self, pseudo_count: f64) -> f64 {
            let $a = self;
            $inner.log_prior(pseudo_count)
        }

        fn free_parameters(&self) -> usize {
            let $a = self;
            $inner.free_parameters()
        }
    };
}
pub(crate) use delegate;

macro_rules! as_target {
    ($([$($generics:tt)*] $type:ty => $target:ty,)*) => {$(
        impl<$($generics)*> Transition for $type
        where
            $target: Transition,
        {
            type Control = <$target as Transition>::Control;

            delegate!(a, control => (**a), control;
                states products blocks evidence needs_logs stored has_restarts check_control);
        }

        impl<$($generics)*> TransitionEntries for $type
        where
            $target: TransitionEntries,
        {
            delegate!(a, control => (**a), control; all_entries);
        }
    )*};
}

// All pointers to an operator are operators, and so is one that learning keeps fixed.
as_target! {
    [A: ?Sized] &A => A,
    [A: ?Sized] Box<A> => A,
    [A: ?Sized] Rc<A> => A,
    [A: ?Sized] Arc<A> => A,
    [A] Fixed<A> => A,
}
