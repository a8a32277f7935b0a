//! The downhill simplex method of Nelder & Mead (1965), the paper's optimiser, with adaptive coefficients and restarts.
//!
//! In 81 dimensions the classical coefficients collapse the simplex. Those of Gao & Han ("Implementing the Nelder-Mead
//! simplex algorithm with adaptive parameters", 2012) depend on the dimension n:
//!
//! ```text
//! reflection 1     expansion 1 + 2/n     contraction 3/4 - 1/(2n)     shrinkage 1 - 1/n
//! ```

use nalgebra::DVector;

use super::evaluation::{Budget, Interruption};
use crate::stop::{Stop, Stopped};

/// First edge of the simplex, as a fraction of each variable's scale.
const EDGE: f64 = 0.2;
/// Later simplices shrink by this factor, so that restarts search ever closer.
const RESTART_SHRINKAGE: f64 = 0.7;
/// Smallest edge of a restarted simplex, relative to the first.
const SMALLEST_EDGE: f64 = 0.05;
/// A simplex whose values differ by no more has converged: those of plans are final times, s, of which no more need be known.
const VALUE_TOLERANCE: f64 = 1e-6;
/// Restarts that gain less are idle: ten times what is left where a simplex has converged.
const SMALLEST_GAIN: f64 = 1e-5;
/// So many idle restarts in a row end the search.
const IDLE_RESTARTS: usize = 3;
/// Iterations per dimension after which a slowly converging simplex is restarted.
const CYCLE_LENGTH: usize = 400;

/// The best point found.
#[derive(Debug, Clone, PartialEq)]
pub struct NelderMeadResult {
    /// The point.
    pub x: DVector<f64>,
    /// What of the budget ended it, if anything did.
    pub ending: Result<(), Interruption>,
}

/// A function to minimise, which ends early when it is stopped.
type Value<'a> = dyn FnMut(&DVector<f64>, Stop) -> Result<f64, Stopped> + 'a;

/// Minimises `value` from `start`, with restarts about the best point until those are idle; each call of `value` takes one rollout
/// from the budget. `scale` is how far each variable may sensibly move.
pub fn minimise_by_nelder_mead(
    value: &mut Value,
    start: &DVector<f64>,
    scale: &DVector<f64>,
    budget: &mut Budget,
) -> NelderMeadResult {
    let mut search = Search { value, budget, best: start.clone(), best_value: f64::INFINITY };
    let ending = search.run(&(scale * EDGE));
    NelderMeadResult { x: search.best, ending }
}

struct Search<'a, 'b> {
    value: &'a mut Value<'a>,
    budget: &'a mut Budget<'b>,
    best: DVector<f64>,
    best_value: f64,
}

/// n + 1 vertices in ascending order of their values, with their sum.
struct Simplex {
    vertices: Vec<(f64, DVector<f64>)>,
    sum: DVector<f64>,
}

impl Search<'_, '_> {
    fn run(&mut self, edge: &DVector<f64>) -> Result<(), Interruption> {
        let mut relative_edge = 1.0;
        let mut idle = 0;
        // Alternating orientation: the new simplex does not repeat the directions of the last.
        for orientation in [1.0, -1.0].into_iter().cycle() {
            let before = self.best_value;
            let mut simplex = self.simplex_about_best(&(edge * (orientation * relative_edge)))?;
            self.descend(&mut simplex)?;
            idle = if before - self.best_value < SMALLEST_GAIN { idle + 1 } else { 0 };
            if idle >= IDLE_RESTARTS {
                break;
            }
            relative_edge = (relative_edge * RESTART_SHRINKAGE).max(SMALLEST_EDGE);
        }
        Ok(())
    }

    fn simplex_about_best(&mut self, edge: &DVector<f64>) -> Result<Simplex, Interruption> {
        let center = self.best.clone();
        let mut vertices = vec![(self.evaluate(&center)?, center.clone())];
        for axis in 0..center.len() {
            let mut vertex = center.clone();
            vertex[axis] += edge[axis];
            vertices.push((self.evaluate(&vertex)?, vertex));
        }
        Ok(Simplex::new(vertices))
    }

    fn descend(&mut self, simplex: &mut Simplex) -> Result<(), Interruption> {
        for _ in 0..CYCLE_LENGTH * self.best.len() {
            if simplex.spread() <= VALUE_TOLERANCE {
                break;
            }
            self.budget.iterations += 1;
            match self.replacement(simplex)? {
                Some((value, vertex)) => simplex.replace_worst(value, vertex),
                None => self.shrink(simplex)?,
            }
        }
        Ok(())
    }

    /// Reflection, expansion or contraction of the worst vertex; none when the simplex must shrink.
    fn replacement(&mut self, simplex: &Simplex) -> Result<Option<(f64, DVector<f64>)>, Interruption> {
        let dimension = self.best.len() as f64;
        let (best, second_worst, worst) = simplex.key_values();
        let reflected = simplex.along_centroid(1.0);
        let reflected_value = self.evaluate(&reflected)?;
        if reflected_value < best {
            let expanded = simplex.along_centroid(1.0 + 2.0 / dimension);
            let expanded_value = self.evaluate(&expanded)?;
            let expansion_wins = expanded_value < reflected_value;
            return Ok(Some(if expansion_wins { (expanded_value, expanded) } else { (reflected_value, reflected) }));
        }
        if reflected_value < second_worst {
            return Ok(Some((reflected_value, reflected)));
        }
        let outside = reflected_value < worst;
        let contraction = 0.75 - 0.5 / dimension;
        let contracted = simplex.along_centroid(if outside { contraction } else { -contraction });
        let contracted_value = self.evaluate(&contracted)?;
        let bound = if outside { reflected_value } else { worst };
        Ok((contracted_value <= bound).then_some((contracted_value, contracted)))
    }

    /// Pulls all vertices towards the best one.
    fn shrink(&mut self, simplex: &mut Simplex) -> Result<(), Interruption> {
        let shrinkage = 1.0 - 1.0 / self.best.len() as f64;
        let best = simplex.vertices[0].1.clone();
        let mut vertices = vec![simplex.vertices[0].clone()];
        for (_, vertex) in &simplex.vertices[1..] {
            let moved = &best + (vertex - &best) * shrinkage;
            vertices.push((self.evaluate(&moved)?, moved));
        }
        *simplex = Simplex::new(vertices);
        Ok(())
    }

    fn evaluate(&mut self, x: &DVector<f64>) -> Result<f64, Interruption> {
        let stop = self.budget.spend()?;
        let value = (self.value)(x, stop)?;
        if value < self.best_value {
            self.best_value = value;
            self.best.copy_from(x);
        }
        Ok(value)
    }
}

impl Simplex {
    fn new(mut vertices: Vec<(f64, DVector<f64>)>) -> Self {
        vertices.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut sum = DVector::zeros(vertices[0].1.len());
        for (_, vertex) in &vertices {
            sum += vertex;
        }
        Self { vertices, sum }
    }

    fn spread(&self) -> f64 {
        let (best, _, worst) = self.key_values();
        worst - best
    }

    /// Values of the best, the second worst and the worst vertex.
    fn key_values(&self) -> (f64, f64, f64) {
        let count = self.vertices.len();
        (self.vertices[0].0, self.vertices[count - 2].0, self.vertices[count - 1].0)
    }

    /// centroid + factor (centroid - worst), with the centroid of all vertices but the worst.
    fn along_centroid(&self, factor: f64) -> DVector<f64> {
        let worst = &self.vertices[self.vertices.len() - 1].1;
        let mut point = (&self.sum - worst) * ((1.0 + factor) / (self.vertices.len() - 1) as f64);
        point.axpy(-factor, worst, 1.0);
        point
    }

    fn replace_worst(&mut self, value: f64, vertex: DVector<f64>) {
        if let Some((_, worst)) = self.vertices.pop() {
            self.sum -= worst;
        }
        self.sum += &vertex;
        let position = self.vertices.partition_point(|(other, _)| *other <= value);
        self.vertices.insert(position, (value, vertex));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;

    /// Values count as 1e10 times as much: the tolerance of 1e-6 is one of 1e-16.
    const UNIT: f64 = 1e10;

    /// The minimum of a function, from a first simplex with an edge of 0.5.
    fn minimum(function: impl Fn(&DVector<f64>) -> f64, start: &[f64]) -> NelderMeadResult {
        let stop = AtomicBool::new(false);
        let (start, scale) = (DVector::from_column_slice(start), DVector::repeat(start.len(), 2.5));
        let mut value = |x: &DVector<f64>, _: Stop| Ok(UNIT * function(x));
        minimise_by_nelder_mead(&mut value, &start, &scale, &mut Budget::new(&stop, 200_000))
    }

    #[test]
    fn rosenbrock_valley_is_followed_to_its_minimum() {
        let result = minimum(|x| (1.0 - x[0]).powi(2) + 100.0 * (x[1] - x[0] * x[0]).powi(2), &[-1.2, 1.0]);
        // A tolerance of 1e-16 leaves sqrt(1e-16) in x.
        assert!((result.x - DVector::from_vec(vec![1.0, 1.0])).amax() < 1e-6);
        assert_eq!(result.ending, Ok(()));
    }

    #[test]
    fn quadratic_in_thirty_dimensions_does_not_collapse() {
        let quadratic = |x: &DVector<f64>| -> f64 {
            x.iter().enumerate().map(|(index, value)| (index + 1) as f64 * (value - 1.0).powi(2)).sum()
        };
        let value = quadratic(&minimum(quadratic, &[0.0; 30]).x);
        assert!(value < 1e-8, "value {value}");
    }

    #[test]
    fn budget_ends_the_search_with_the_best_point() {
        let stop = AtomicBool::new(false);
        let mut least = f64::INFINITY;
        let mut value = |x: &DVector<f64>, _: Stop| {
            least = least.min(x.norm_squared());
            Ok(x.norm_squared())
        };
        let (start, scale) = (DVector::from_vec(vec![3.0, 4.0]), DVector::repeat(2, 2.5));
        let result = minimise_by_nelder_mead(&mut value, &start, &scale, &mut Budget::new(&stop, 25));
        assert_eq!(result.ending, Err(Interruption::RolloutLimit));
        assert!(least < 25.0);
        assert_eq!(least, result.x.norm_squared());
    }
}
