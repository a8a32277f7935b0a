//! Server-sent events of a solve: `queued`, `progress` as it comes, and last either `result` or `problem`.

use std::convert::Infallible;
use std::time::Duration;

use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream::{Stream, unfold};

use super::problem_json;
use crate::api::access::RequestContext;
use crate::api::message::response::{ProgressEvent, QueuedEvent};
use crate::api::problem::Problem;
use crate::service::{RunningSolve, SolveEvent};

/// A comment this often keeps proxies from closing a quiet stream.
const HEARTBEAT: Duration = Duration::from_secs(15);
/// Tells nginx to pass events on at once.
const ACCEL_BUFFERING: HeaderName = HeaderName::from_static("x-accel-buffering");

/// Whether the caller asks for events.
pub(super) fn are_accepted(headers: &HeaderMap) -> bool {
    let values = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let mut media_types = values.flat_map(|value| value.split(',')).filter_map(|item| item.split(';').next());
    media_types.any(|media_type| media_type.trim().eq_ignore_ascii_case("text/event-stream"))
}

/// The events of a solve whose result is JSON. A caller who leaves drops the stream, which stops the solve.
pub(super) fn respond(running: RunningSolve<Vec<u8>>, context: RequestContext) -> Response {
    let events = Sse::new(events_of(running, context)).keep_alive(KeepAlive::new().interval(HEARTBEAT));
    ([(ACCEL_BUFFERING, HeaderValue::from_static("no"))], events).into_response()
}

/// What is to be told next.
enum Stage {
    Queued(RunningSolve<Vec<u8>>),
    Running(RunningSolve<Vec<u8>>),
    Ended,
}

fn events_of(
    running: RunningSolve<Vec<u8>>,
    context: RequestContext,
) -> impl Stream<Item = Result<Event, Infallible>> + Send {
    unfold((Stage::Queued(running), context), |(stage, context)| async move {
        let (event, stage) = match stage {
            Stage::Queued(running) => {
                let queued = QueuedEvent { position: running.position() };
                (named("queued", json(&queued)), Stage::Running(running))
            }
            Stage::Running(mut running) => match running.next_event().await {
                SolveEvent::Progress(progress) => {
                    (named("progress", json(&ProgressEvent::from(progress))), Stage::Running(running))
                }
                SolveEvent::Ended(Ok(answer)) => (named("result", answer), Stage::Ended),
                SolveEvent::Ended(Err(error)) => {
                    let body = problem_json::body(&Problem::from(error), &context.path, &context.request_id);
                    (named("problem", body), Stage::Ended)
                }
            },
            Stage::Ended => return None,
        };
        Some((Ok(event), (stage, context)))
    })
}

fn named(name: &'static str, json: Vec<u8>) -> Event {
    // Written by serde: valid UTF-8 on one line.
    Event::default().event(name).data(String::from_utf8(json).unwrap_or_default())
}

fn json<T: serde::Serialize>(message: &T) -> Vec<u8> {
    serde_json::to_vec(message).expect("an event of numbers is valid JSON")
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, channel};
    use std::sync::{Arc, Mutex};

    use futures_util::StreamExt as _;

    use super::*;
    use crate::service::domain::{SimulateInput, Simulation, Solution, SolveInput};
    use crate::service::{InProcessSolver, ManeuverSolver, Service, ServiceSettings, SolveClocks};
    use crate::solver::RunControl;

    /// Solves when the test says so.
    struct HeldSolver(Mutex<Receiver<()>>);

    impl ManeuverSolver for HeldSolver {
        fn solve(&self, input: &SolveInput, control: &RunControl<'_>) -> Solution {
            let _ = self.0.lock().unwrap().recv();
            InProcessSolver.solve(input, control)
        }

        fn simulate(&self, input: &SimulateInput) -> Simulation {
            InProcessSolver.simulate(input)
        }
    }

    #[tokio::test(start_paused = true)]
    async fn quiet_stream_has_a_heartbeat() {
        let (release, released) = channel();
        let solver = Arc::new(HeldSolver(Mutex::new(released)));
        let service = Service::start(ServiceSettings::default(), solver).unwrap();
        let clocks = SolveClocks { time_limit: Duration::from_secs(60), deadline: None };
        let running = service.reserve().unwrap().start_solve(SolveInput::forward_drive(), clocks, |_| b"{}".to_vec());
        let context = RequestContext::of("/solve", &HeaderMap::new());
        let mut body = respond(running.unwrap(), context).into_body().into_data_stream();
        // The clock jumps to the next timer whenever nothing else is to be done.
        let begin = tokio::time::Instant::now();
        let queued = body.next().await.unwrap().unwrap();
        assert!(queued.starts_with(b"event: queued"));
        for beat in 1..=3 {
            let comment = body.next().await.unwrap().unwrap();
            assert!(comment.starts_with(b":"), "{comment:?}");
            assert_eq!(begin.elapsed().as_secs(), beat * HEARTBEAT.as_secs());
        }
        drop(release);
    }

    #[test]
    fn events_are_sent_to_those_who_ask() {
        let accepts = |value: &'static str| {
            are_accepted(&HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(value))]))
        };
        assert!(accepts("text/event-stream") && accepts("application/json;q=0.5, Text/Event-Stream; q=1"));
        assert!(!accepts("application/json") && !accepts("*/*") && !are_accepted(&HeaderMap::new()));
    }
}
