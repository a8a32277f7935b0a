//! The good callers: each asks one question over and over and checks every answer.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use reqwest::Client;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, sleep, timeout};
use tonic::transport::{Channel, Endpoint};

use super::ledger::{Ledger, Outcome};
use super::question::{Failure, Question, STAY};
use super::{grpc, rest};
use crate::callers::Transport;
use crate::hostile::good::{Connections, client};
use crate::hostile::program::Program;

/// A request without an answer for so long is lost: the longest jobs before it take a few seconds.
const PATIENCE: Duration = Duration::from_secs(30);
/// Before the one attempt after a connection was cut.
const RETRY_DELAY: Duration = Duration::from_millis(100);

/// What all callers share.
#[derive(Default)]
struct Shared {
    ledger: Mutex<Ledger>,
    /// What each question is answered while nothing is wrong.
    expected: BTreeMap<Question, String>,
    /// Whether attackers take all places for connections.
    is_crowded: AtomicBool,
}

/// All good callers of one server.
pub struct SteadyCallers {
    tasks: JoinSet<()>,
    stop: watch::Sender<bool>,
    shared: Arc<Shared>,
}

impl SteadyCallers {
    /// Learns the answers, by REST where it can, and begins to ask.
    pub async fn start(program: &Program) -> Self {
        let mut shared = Shared::default();
        for question in Question::ALL.into_iter().filter(|question| *question != Question::HangUp) {
            let doors = [Transport::Rest, Transport::Grpc];
            let door = doors.into_iter().find(|door| question.is_asked_over(*door)).unwrap();
            let answer = Caller::new(program, question, door, Connections::Fresh).ask().await;
            shared.expected.insert(question, answer.expect("the server answers while nothing is wrong"));
        }
        let (stop, stopped) = watch::channel(false);
        let (mut tasks, shared) = (JoinSet::new(), Arc::new(shared));
        for question in Question::ALL {
            for door in [Transport::Rest, Transport::Grpc].into_iter().filter(|door| question.is_asked_over(*door)) {
                for connections in [Connections::Kept, Connections::Fresh] {
                    let caller = Caller::new(program, question, door, connections);
                    tasks.spawn(caller.ask_until(stopped.clone(), Arc::clone(&shared)));
                }
            }
        }
        Self { tasks, stop, shared }
    }

    /// While it is crowded, a connection may be cut before an answer.
    pub fn set_crowded(&self, is_crowded: bool) {
        self.shared.is_crowded.store(is_crowded, Ordering::Relaxed);
    }

    /// The account since the last time that it was taken.
    pub fn take_ledger(&self) -> Ledger {
        std::mem::take(&mut *self.shared.ledger.lock().unwrap())
    }

    /// Waits for the last answers.
    pub async fn stop(mut self) -> Ledger {
        self.stop.send_replace(true);
        while self.tasks.join_next().await.transpose().unwrap().is_some() {}
        self.take_ledger()
    }
}

struct Caller {
    question: Question,
    door: Transport,
    connections: Connections,
    rest: String,
    client: Client,
    endpoint: Endpoint,
    channel: Channel,
}

impl Caller {
    fn new(program: &Program, question: Question, door: Transport, connections: Connections) -> Self {
        let endpoint = Endpoint::from_shared(format!("http://{}", program.grpc)).unwrap();
        let (rest, channel) = (format!("http://{}", program.rest), endpoint.connect_lazy());
        Self { question, door, connections, rest, client: client(), endpoint, channel }
    }

    fn name(&self) -> String {
        format!("{:?} {:?} {:?}", self.connections, self.door, self.question).to_lowercase()
    }

    async fn ask_until(self, mut stopped: watch::Receiver<bool>, shared: Arc<Shared>) {
        let mut ticks = interval(self.question.interval());
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        while !*stopped.borrow() {
            tokio::select! {
                _ = stopped.changed() => return,
                _ = ticks.tick() => {}
            }
            shared.ledger.lock().unwrap().send();
            let outcome = self.outcome(&shared).await;
            shared.ledger.lock().unwrap().record(outcome);
        }
    }

    /// Asks, and once more where a crowd had the connection cut.
    async fn outcome(&self, shared: &Shared) -> Outcome {
        let was_crowded = shared.is_crowded.load(Ordering::Relaxed);
        let mut end = self.end_of_one().await;
        if matches!(end, End::Failed(Failure::Cut)) && (was_crowded || shared.is_crowded.load(Ordering::Relaxed)) {
            shared.ledger.lock().unwrap().retry(self.name());
            sleep(RETRY_DELAY).await;
            end = self.end_of_one().await;
        }
        let unexpected = |words: &str| Outcome::Unexpected(format!("{}: {words}", self.name()));
        match end {
            End::Left => Outcome::Left,
            End::Lost => unexpected("no answer"),
            End::Answered(content) if shared.expected.get(&self.question) == Some(&content) => Outcome::Answered,
            End::Answered(content) => unexpected(&content),
            End::Failed(Failure::Refused(code)) => Outcome::Refused(code),
            End::Failed(Failure::Cut) => unexpected("cut"),
            End::Failed(Failure::Unexpected(words)) => unexpected(&words),
        }
    }

    async fn end_of_one(&self) -> End {
        let is_leaving = self.question == Question::HangUp;
        match timeout(if is_leaving { STAY } else { PATIENCE }, self.ask()).await {
            Ok(Ok(content)) => End::Answered(content),
            Ok(Err(failure)) => End::Failed(failure),
            Err(_) if is_leaving => End::Left,
            Err(_) => End::Lost,
        }
    }

    async fn ask(&self) -> Result<String, Failure> {
        match (self.door, self.connections) {
            (Transport::Rest, Connections::Kept) => rest::ask(&self.client, &self.rest, self.question).await,
            (Transport::Rest, Connections::Fresh) => rest::ask(&client(), &self.rest, self.question).await,
            (Transport::Grpc, Connections::Kept) => grpc::ask(self.channel.clone(), self.question).await,
            (Transport::Grpc, Connections::Fresh) => grpc::ask(self.endpoint.connect_lazy(), self.question).await,
        }
    }
}

/// How one attempt ended.
enum End {
    /// With what the answer says.
    Answered(String),
    Failed(Failure),
    Left,
    Lost,
}
