//! Numbers of requests as callers mean them.

/// What has numbers; implemented for all messages of requests by the build.
pub trait Numbers {
    /// Makes each -0 a 0: to callers these are one number, so they have one hash and one answer.
    fn unify_zeros(&mut self);
}

impl Numbers for f64 {
    fn unify_zeros(&mut self) {
        // The sum of both zeros is 0; all else stays as it is.
        *self += 0.0;
    }
}

impl<T: Numbers> Numbers for Option<T> {
    fn unify_zeros(&mut self) {
        self.iter_mut().for_each(T::unify_zeros);
    }
}

impl<T: Numbers> Numbers for Vec<T> {
    fn unify_zeros(&mut self) {
        self.iter_mut().for_each(T::unify_zeros);
    }
}

impl<T: Numbers> Numbers for Box<T> {
    fn unify_zeros(&mut self) {
        T::unify_zeros(self);
    }
}
