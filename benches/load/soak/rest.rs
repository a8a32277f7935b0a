//! Questions over REST.

use std::collections::HashMap;

use axum::body::Bytes;
use reqwest::{Client, RequestBuilder};
use serde::de::DeserializeOwned;
use serde_json::Value;
use slipdrive::api::grpc::pb;

use super::question::{DEADLINE, Failure, Question, content_of_motion, simulation};
use crate::hostile::KEY;

/// What the answer says.
pub async fn ask(client: &Client, base: &str, question: Question) -> Result<String, Failure> {
    let post = |path: &str, body: String| {
        let request = client.post(format!("{base}{path}")).bearer_auth(KEY);
        request.header("content-type", "application/json").body(body)
    };
    let solve = || serde_json::to_string(&question.solve()).unwrap();
    match question {
        Question::Health => {
            let answer: HashMap<String, String> = read(&body_of(client.get(format!("{base}/livez")), question).await?)?;
            Ok(answer.get("status").cloned().unwrap_or_default())
        }
        Question::Validate => {
            let answer: pb::ValidateResponse = read(&body_of(post("/validate", solve()), question).await?)?;
            Ok(answer.input_hash)
        }
        Question::Simulate => {
            let request = post("/simulate", serde_json::to_string(&simulation()).unwrap());
            content_of_motion(&read(&body_of(request, question).await?)?)
        }
        Question::Events => {
            let body = body_of(post("/solve/events", solve()), question).await?;
            content_of_events(question, &String::from_utf8_lossy(&body))
        }
        Question::Solve | Question::SolvePlan | Question::SolveUntilDeadline | Question::HangUp | Question::Batch => {
            let mut request = post("/solve", solve());
            if question == Question::SolveUntilDeadline {
                request = request.header("request-timeout-ms", DEADLINE.as_millis().to_string());
            }
            question.content_of(&read(&body_of(request, question).await?)?)
        }
    }
}

async fn body_of(request: RequestBuilder, question: Question) -> Result<Bytes, Failure> {
    let answer = request.send().await.map_err(|_| Failure::Cut)?;
    let status = answer.status();
    let body = answer.bytes().await.map_err(|_| Failure::cut_in_the_answer())?;
    if status.is_success() {
        return Ok(body);
    }
    let problem: Value = serde_json::from_slice(&body).unwrap_or_default();
    let code = problem["code"].as_str().map_or_else(|| status.to_string(), str::to_owned);
    Err(Failure::refusal(question, code))
}

fn read<T: DeserializeOwned>(body: &[u8]) -> Result<T, Failure> {
    serde_json::from_slice(body).map_err(|error| Failure::Unexpected(error.to_string()))
}

/// What the last of the events says; the first must tell the place in the queue.
fn content_of_events(question: Question, text: &str) -> Result<String, Failure> {
    let field = |event: &str, name: &str| event.lines().find_map(|line| Some(line.strip_prefix(name)?.to_owned()));
    let events = text.split("\n\n").filter_map(|event| Some((field(event, "event: ")?, field(event, "data: ")?)));
    let events: Vec<_> = events.collect();
    match events.as_slice() {
        [(first, _), .., (last, data)] if first == "queued" && last == "result" => {
            question.content_of(&read(data.as_bytes())?)
        }
        [.., (last, data)] if last == "problem" => {
            let problem: Value = read(data.as_bytes())?;
            Err(Failure::refusal(question, problem["code"].as_str().unwrap_or("no code").to_owned()))
        }
        _ => Err(Failure::cut_in_the_answer()),
    }
}
