//! What a command writes beside the answer: the saved plan, figures, numbers and the report.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use slipdrive::contract::json;
use slipdrive::contract::message::PresentRequest;
use slipdrive::jobs::plan::AcceptedPlan;
use slipdrive::jobs::present::Present;
use slipdrive::jobs::{InProcessSolver, Jobs, Kind as _};
use slipdrive::service::{Class, Service};

use super::outputs::Writer;
use crate::config::JobArguments;

/// Whether anything is to be drawn or written beside the answer and its saved plan.
pub(super) fn is_asked_for(arguments: &JobArguments) -> bool {
    arguments.report.is_some() || arguments.svg.is_some() || arguments.csv.is_some()
}

/// Writes what the arguments ask for.
///
/// # Errors
/// Plans that cannot be shown.
pub(super) fn write(
    request: &PresentRequest,
    jobs: &Jobs,
    service: &Service,
    arguments: &JobArguments,
    writer: &mut Writer,
) -> anyhow::Result<()> {
    if let Some(path) = &arguments.save {
        let saved = match request.plans.as_slice() {
            [plan] => json::write(plan),
            _ => json::write(request),
        };
        writer.file(path, &saved);
    }
    if !is_asked_for(arguments) {
        return Ok(());
    }
    let request = PresentRequest { report: arguments.report.is_some(), ..request.clone() };
    let input = Present::accept(request, &jobs.limits().without_clock())?;
    if let Some(path) = &arguments.csv {
        let csv = AcceptedPlan::csv(&input.plans, &InProcessSolver, (&AtomicBool::new(false)).into());
        writer.file(path, csv.map_err(|_| anyhow::anyhow!("the motion was stopped"))?.as_bytes());
    }
    if arguments.report.is_none() && arguments.svg.is_none() {
        return Ok(());
    }
    let permit = service.reserve(Class::Light)?;
    let response = permit.submit(Arc::clone(&jobs.present), input, None, Present::answer)?;
    let response = response.blocking_outcome()?;
    if let Some(folder) = &arguments.svg {
        let figures = response.figures.iter().map(|figure| (format!("{}.svg", figure.name), figure.svg.as_bytes()));
        writer.folder(folder, figures);
    }
    if let Some(path) = &arguments.report {
        writer.file(path, response.report_html.as_bytes());
    }
    Ok(())
}
