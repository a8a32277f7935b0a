//! Figures of real plans.
