//! Server-sent events of a job: `queued`, `progress` as it comes, and last either `result` or `problem`.

use std::convert::Infallible;
use std::time::Duration;

use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt as _;

use super::coding::weight;
use super::problem_json;
use crate::api::access::RequestContext;
use crate::contract::Problem;
use crate::contract::convert::count;
use crate::contract::json::write;
use crate::contract::message::Queued;
use crate::jobs::Kind;
use crate::service::{Event as JobEvent, Running};

/// A comment this often keeps proxies from closing a quiet stream.
const HEARTBEAT: Duration = Duration::from_secs(15);
/// Makes nginx pass events and lines on at once.
pub(super) const UNBUFFERED: [(HeaderName, HeaderValue); 1] =
    [(HeaderName::from_static("x-accel-buffering"), HeaderValue::from_static("no"))];

/// Whether the caller asks for events, and likes JSON no better where that is named too.
pub(super) fn are_accepted(headers: &HeaderMap) -> bool {
    let values = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let (mut events, mut json) = (0.0_f32, 0.0_f32);
    for item in values.flat_map(|value| value.split(',')) {
        let mut parts = item.split(';');
        let media_type = parts.next().unwrap_or_default().trim();
        if media_type.eq_ignore_ascii_case("text/event-stream") {
            events = events.max(weight(parts));
        } else if media_type.eq_ignore_ascii_case("application/json") {
            json = json.max(weight(parts));
        }
    }
    events > 0.0 && events >= json
}

/// The events of a job whose result is JSON. A caller who leaves drops the stream, which stops the job.
pub(super) fn respond<K: Kind, T: Into<Vec<u8>> + Send + 'static>(
    running: Running<T, K::Progress>,
    context: RequestContext,
) -> Response {
    let events = running.events().map(move |event| Ok::<_, Infallible>(written::<K, T>(event, &context)));
    let stream = Sse::new(events).keep_alive(KeepAlive::new().interval(HEARTBEAT));
    (UNBUFFERED, stream).into_response()
}

fn written<K: Kind, T: Into<Vec<u8>>>(event: JobEvent<T, K::Progress>, context: &RequestContext) -> Event {
    match event {
        JobEvent::Queued(position) => named("queued", write(&Queued { position: count(position) })),
        JobEvent::Progress(progress) => named("progress", write(&K::Report::from(progress))),
        JobEvent::Ended(Ok(answer)) => named("result", answer.into()),
        JobEvent::Ended(Err(error)) => {
            let problem = Problem::from(error);
            context.notes.problem(problem.code());
            named("problem", problem_json::body(&problem, &context.path, &context.request_id))
        }
    }
}

fn named(name: &'static str, json: Vec<u8>) -> Event {
    // Written by serde: valid UTF-8 on one line.
    Event::default().event(name).data(String::from_utf8(json).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, channel};
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::jobs::solve::Solve;
    use crate::service::{Class, Cost, Done, Job, JobControl, Service, ServiceSettings, Stopped};

    /// Ends when the test says so.
    struct Held(Mutex<Receiver<()>>);

    impl Job for Held {
        const NAME: &'static str = "held";
        type Input = ();
        type Output = ();
        type Progress = <Solve as Job>::Progress;

        fn cost(&self, (): &()) -> Cost {
            Cost::seconds(1.0)
        }

        fn run(&self, (): &(), _control: &JobControl<'_, Self::Progress>) -> Result<(), Stopped> {
            let _ = self.0.lock().unwrap().recv();
            Ok(())
        }
    }

    #[tokio::test(start_paused = true)]
    async fn quiet_stream_has_a_heartbeat() {
        let (release, released) = channel();
        let service = Service::start(ServiceSettings::default()).unwrap();
        let answer = |(): &(), _: &Done<()>| b"{}".to_vec();
        let held = Arc::new(Held(Mutex::new(released)));
        let running = service.reserve(Class::Heavy).unwrap().submit(held, (), None, answer).unwrap();
        let context = RequestContext::open("/solve", &HeaderMap::new(), None).0;
        let mut body = respond::<Solve, _>(running, context).into_body().into_data_stream();
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
        assert!(accepts("application/json, text/event-stream") && accepts("*/*, text/event-stream;q=0.5"));
        assert!(!accepts("application/json, text/event-stream;q=0.5") && !accepts("text/event-stream;q=0"));
        assert!(!accepts("application/json") && !accepts("*/*") && !are_accepted(&HeaderMap::new()));
    }
}
