//! The answer of an assessment, as a message.

use super::accept::AcceptedAssess;
use crate::assessment::{Assessment, EndError, ParameterShares, QUANTILES, WorstSample};
use crate::contract::convert::{count, footprint};
use crate::contract::message::{
    self, AppliedChange, AssessResponse, EndErrors, ErrorQuantile, LimitExcess, SimulateGrid, SimulateRequest,
    VarianceShares,
};
use crate::jobs::simulate::name_at_root;
use crate::motion::ChangedParameter;

pub(super) fn answer(accepted: &AcceptedAssess, assessment: &Assessment) -> AssessResponse {
    let Assessment {
        sample_count,
        success_count,
        interval: (low, high),
        refused_count,
        separated_count,
        grid,
        nominal,
        mean,
        quantiles,
        shares,
        excesses,
        worst,
    } = assessment;
    let quantile = |(&share, error): (&f64, &EndError)| ErrorQuantile { share, errors: Some(end_errors(error)) };
    AssessResponse {
        samples: count(*sample_count),
        successes: count(*success_count),
        success_rate: *success_count as f64 / *sample_count as f64,
        success_rate_low: *low,
        success_rate_high: *high,
        refused: count(*refused_count),
        separations: count(*separated_count),
        steps: count(grid.step_count),
        grid_factor: count(grid.factor),
        nominal_success: nominal.is_success,
        nominal: Some(end_errors(&nominal.error)),
        mean: Some(end_errors(mean)),
        quantiles: QUANTILES.iter().zip(quantiles).map(quantile).collect(),
        shares: shares.iter().map(variance_shares).collect(),
        limits: excesses
            .iter()
            .map(|excess| LimitExcess {
                limit: limit_name(accepted, excess.limit).to_owned(),
                value: excess.value,
                samples: count(excess.sample_count),
            })
            .collect(),
        worst: worst.as_ref().map(|worst| Box::new(worst_sample(accepted, worst))),
    }
}

pub(super) fn limit_name(accepted: &AcceptedAssess, limit: &'static str) -> &'static str {
    if accepted.is_simulation() { name_at_root(limit) } else { limit }
}

fn end_errors(error: &EndError) -> EndErrors {
    let [along_m, across_m, distance_m, heading_rad, speed_m_s] = *error;
    EndErrors { along_m, across_m, distance_m, heading_rad, speed_m_s }
}

fn number(parameter: ChangedParameter) -> i32 {
    message::ChangedParameter::from(parameter).into()
}

fn variance_shares(of: &ParameterShares) -> VarianceShares {
    let [along, across, distance, heading, speed] = of.shares;
    VarianceShares { parameter: number(of.parameter), along, across, distance, heading, speed }
}

fn worst_sample(accepted: &AcceptedAssess, worst: &WorstSample) -> message::WorstSample {
    let WorstSample { index, changes, error, relative_error, separates, motion } = worst;
    let change = |&(parameter, change): &(ChangedParameter, f64)| AppliedChange {
        parameter: number(parameter),
        change,
        unit: parameter.unit().to_owned(),
    };
    let simulate = SimulateRequest {
        robot: Some(message::Robot { footprint: footprint(&accepted.footprint), ..(&motion.bare_robot).into() }),
        payload: motion.payload.as_ref().map(Into::into),
        reference_point: message::ReferencePoint::AxleMidpoint.into(),
        start: Some((&motion.start).into()),
        torque_schedule: Some((&motion.schedule).into()),
        grid: Some(SimulateGrid { steps: Some(count(motion.step_count)) }),
        ..SimulateRequest::default()
    };
    message::WorstSample {
        sample: count(*index),
        relative_error: *relative_error,
        errors: Some(end_errors(error)),
        separates: *separates,
        changes: changes.iter().map(change).collect(),
        simulate: Some(simulate),
    }
}
