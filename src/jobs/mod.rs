//! The kinds of jobs: one folder each, and one line each in the registry below.
//!
//! Transports, the command line and the OpenAPI document reach them through [`Kind`], by a [`Visitor`]; none of them
//! lists the kinds.

pub mod assess;
pub mod export;
mod idle_workers;
mod kind;
mod limits;
pub mod plan;
pub mod present;
pub mod simulate;
pub mod solve;
mod solver;
mod table;

use std::sync::Arc;

pub use kind::{AsWritten, Example, File, Flag, Kind, ProgressLine};
pub use limits::{Clock, DEFAULT_TIME_LIMIT_S, Limits, limits_message};
pub use solver::{InProcessSolver, ManeuverSolver};

use crate::metrics::Metrics;
use crate::metrics::catalogue::{self, Family};
use crate::service::Job as _;

/// What a step of a rollout takes a small cloud machine, s.
const STEP_S: f64 = 3e-6;
/// Arrays of a full answer with one number per step: trajectory and contacts.
const ARRAYS_OF_STEPS: usize = 26;

/// What is done with each kind.
pub trait Visitor {
    /// One kind.
    fn visit<K: Kind>(&mut self, kind: &Arc<K>);
}

macro_rules! registry {
    ($($(#[$doc:meta])* $name:ident: $kind:ty),* $(,)?) => {
        /// One of each kind of job, and what they accept.
        #[derive(Clone)]
        pub struct Jobs {
            limits: Limits,
            $($(#[$doc])* pub $name: Arc<$kind>),*
        }

        impl Jobs {
            /// All kinds of one server, which share its solver and its metrics.
            pub fn new(limits: Limits, solver: Arc<dyn ManeuverSolver>, metrics: &Metrics) -> Self {
                $(metrics.expect_jobs(<$kind>::NAME);)*
                Self { limits, $($name: Arc::new(<$kind>::new(Arc::clone(&solver), metrics))),* }
            }

            /// Shows every kind to the visitor.
            pub fn each(&self, visitor: &mut impl Visitor) {
                $(visitor.visit(&self.$name);)*
            }

            /// All families of metrics of a server, those of the kinds included.
            pub fn families() -> Vec<Family> {
                [catalogue::ALL, $(<$kind>::FAMILIES),*].concat()
            }
        }
    };
}

registry! {
    /// The search for the fastest maneuver.
    solve: solve::Solve,
    /// One rollout.
    simulate: simulate::Simulate,
    /// Figures and sentences.
    present: present::Present,
    /// Files for controllers.
    export: export::Export,
    /// Samples of plans under what is not known.
    assess: assess::Assess,
}

impl Jobs {
    /// What is accepted at most.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }
}
