//! Random maneuvers of the suite's robots: fresh ones for each seed, as `draw.rs` describes.

use anyhow::Result;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::arguments::RandomArguments;
use crate::draw::{Draw, KINDS};
use crate::suite::{Case, read_cases};

/// The robots of the acceptance; the others of the suite vary single laws.
const ROBOTS: [&str; 6] = ["reference", "warehouse", "slippery", "grippy", "offset", "tall"];

/// The random maneuvers of a seed.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn maneuvers(arguments: &RandomArguments) -> Result<Vec<Case>> {
    let (robots, suite) = read_cases()?;
    let mut cases = Vec::new();
    for (number, name) in (0_u64..).zip(ROBOTS) {
        let robot = &robots[name];
        let prefix = format!("{name}/");
        let parameters = suite.iter().find(|case| case.name.starts_with(&prefix));
        let parameters = parameters.map(|case| *case.accepted.input.robot.parameters()).unwrap_or_default();
        let torque_limit = robot.torque_limit();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(arguments.seed.wrapping_mul(ROBOTS.len() as u64) + number);
        for index in 0..arguments.per_robot {
            let kind = KINDS[index % KINDS.len()];
            let maneuver = Draw { rng: &mut rng, parameters: &parameters, torque_limit }.maneuver(kind);
            cases.push(Case::new(format!("{name}/{kind}-{index}"), robot.body(maneuver))?);
        }
    }
    Ok(cases)
}
