//! The caller over REST.

use anyhow::{Context as _, Result, ensure};
use serde_json::{Value, json};

use super::requests::{COASTING_S, COASTING_STEPS, Request};
use crate::suite::simulate_body;
use crate::values::digest_of_values;

/// Stop reasons of answers that another run may not repeat.
const OUT_OF_TIME: [&str; 2] = ["time_limit", "deadline"];

/// Asks over REST.
pub(super) struct RestCaller {
    address: String,
    client: reqwest::Client,
}

/// What came of a request.
pub(super) struct RestAnswers {
    pub(super) input_hash: String,
    /// Of the plan and of its motion.
    pub(super) digests: [String; 2],
}

impl RestCaller {
    pub(super) fn new(address: String) -> Result<Self> {
        Ok(Self { address, client: reqwest::Client::builder().no_proxy().build()? })
    }

    /// Asks for a plan and for the motion under its torques.
    pub(super) async fn ask(&self, request: &Request) -> Result<RestAnswers> {
        let answer = self.post("/solve", &request.body).await?;
        let plan: Value = serde_json::from_slice(&answer)?;
        let stop_reason = plan["stop_reason"].as_str().context("no stop reason")?;
        ensure!(!OUT_OF_TIME.contains(&stop_reason), "REST: stopped by wall time");
        let motion = self.post("/simulate", &motion_of(request, &plan)?).await?;
        let input_hash = plan["input_hash"].as_str().context("no input hash")?.to_owned();
        Ok(RestAnswers { input_hash, digests: [digest_of_values(&answer)?, digest_of_values(&motion)?] })
    }

    async fn post(&self, path: &str, body: &Value) -> Result<Vec<u8>> {
        let response = self.client.post(format!("{}{path}", self.address)).json(body).send().await?;
        let status = response.status();
        let answer = response.bytes().await?;
        ensure!(status.is_success(), "{path}: {status}: {}", String::from_utf8_lossy(&answer));
        Ok(answer.to_vec())
    }
}

/// The body of `/simulate` for a plan.
fn motion_of(request: &Request, plan: &Value) -> Result<Value> {
    let schedule = &plan["torque_schedule"];
    let is_empty = schedule["left_n_m"].as_array().context("no torques")?.is_empty();
    let coasting = json!({ "interval_s": COASTING_S, "left_n_m": [0.0], "right_n_m": [0.0] });
    let (schedule, steps) =
        if is_empty { (&coasting, &json!(COASTING_STEPS)) } else { (schedule, &plan["report"]["steps"]) };
    let steps = request.fixed_point_steps.map_or(steps.as_u64().context("no steps")?, u64::from);
    let mut body = simulate_body(&request.body, schedule, steps);
    if request.fixed_point_steps.is_some() {
        body["contact_solver"] = json!("fixed_point");
    }
    Ok(body)
}
