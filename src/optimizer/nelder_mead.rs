//! Nelder-Mead.
/// x
pub struct NelderMeadResult;
/// x
pub struct NelderMeadSettings;
/// x
pub fn minimise_by_nelder_mead() {}
