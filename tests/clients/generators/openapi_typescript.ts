// Solves with the types that openapi-typescript made: node openapi_typescript.js URL

import assert from "node:assert/strict";
import createClient from "openapi-fetch";
import type { components, paths } from "./slipdrive";

type SolveRequest = components["schemas"]["SolveRequest"];

async function main(): Promise<void> {
  const client = createClient<paths>({ baseUrl: process.argv[2] });
  const deadline = { header: { "Request-Timeout-Ms": 5000 } };

  const request: SolveRequest = {maneuver: {goal: {y_m: 5}}};
  const { data: answer } = await client.POST("/solve", { params: deadline, body: request });
  assert(answer, "it is solved");
  const finalTime: number = answer.final_time_s;
  assert(finalTime > 2 && finalTime < 10, `${finalTime}`);
  // The types are no `any`: these two must not compile.
  // @ts-expect-error
  const text: string = answer.final_time_s;
  // @ts-expect-error
  const misspelt: SolveRequest = { maneuver: { goal: { y: 5 } } };

  // A misspelt field is refused by the server too.
  const refused = await client.POST("/solve", { body: misspelt });
  assert.equal(refused.response.status, 422);
  assert(refused.error && refused.error.code === "invalid_field", JSON.stringify(refused.error));

  const { error: problem } = await client.POST("/solve", { body: { robot: { wheel_radius_m: 0 } } });
  const pointer: string | undefined = problem?.errors[0]?.pointer;
  assert.equal(pointer, "#/robot/wheel_radius_m");
  console.log(`final time: ${finalTime.toFixed(3)} s; refused: ${pointer}`);
}

main().catch((error: unknown) => {
  console.error(error);
  process.exit(1);
});
