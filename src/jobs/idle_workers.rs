//! The service's idle workers as helpers of the numerics.

use crate::service::JobControl;
use crate::solver::{Helpers, SharedWork};

/// Lends the idle workers to a job.
pub(super) struct IdleWorkers<'a, P>(pub(super) &'a JobControl<'a, P>);

impl<P: Send + Sync> Helpers for IdleWorkers<'_, P> {
    fn share(&self, work: &dyn SharedWork) {
        self.0.share(&|| work.open_parts(), &|is_recalled| work.take_part(is_recalled));
    }
}
