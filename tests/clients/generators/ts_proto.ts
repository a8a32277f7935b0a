// Calls a server with the code that ts-proto made: node ts_proto.js HOST:PORT

import assert from "node:assert/strict";
import { credentials, Metadata, type ServiceError, status } from "@grpc/grpc-js";
import { BadRequest, ErrorInfo } from "./google/rpc/error_details";
import { Status as RpcStatus } from "./google/rpc/status";
import { ManeuverServiceClient, SolveRequest, SolveResponse } from "./slipdrive/v1/maneuver_service";
import { Status } from "./slipdrive/v1/solution";

function solve(client: ManeuverServiceClient, request: SolveRequest): Promise<SolveResponse> {
  return new Promise((resolve, reject) => {
    const deadline = new Date(Date.now() + 60_000);
    client.solve(request, new Metadata(), { deadline }, (error, answer) => (error ? reject(error) : resolve(answer)));
  });
}

async function main(): Promise<void> {
  const client = new ManeuverServiceClient(process.argv[2]!, credentials.createInsecure());

  const request = SolveRequest.fromPartial({
    maneuver: { goal: { y_m: 5 } },
    grid: { steps: 200 },
    solver: { starts: 1 },
  });
  const { solution } = await solve(client, request);
  assert(solution?.status === Status.STATUS_CONVERGED, `${solution?.status}`);
  const finalTime: number = solution.final_time_s;
  assert(finalTime > 2 && finalTime < 10, `${finalTime}`);
  assert.equal(solution.trajectory?.time_s.length, 201);

  const refusal: ServiceError = await solve(client, SolveRequest.fromPartial({ robot: { wheel_radius_m: 0 } })).then(
    () => assert.fail("the robot is refused"),
    (error) => error,
  );
  assert.equal(refusal.code, status.INVALID_ARGUMENT);
  const [encoded] = refusal.metadata.get("grpc-status-details-bin");
  const details = RpcStatus.decode(encoded as Buffer).details;
  const detail = (name: string) => details.find((any) => any.type_url === `type.googleapis.com/google.rpc.${name}`)!.value;
  assert.equal(ErrorInfo.decode(detail("ErrorInfo")).reason, "INVALID_VALUE");
  const field = BadRequest.decode(detail("BadRequest")).field_violations[0]?.field;
  assert.equal(field, "robot.wheel_radius_m");
  console.log(`final time: ${finalTime.toFixed(3)} s; refused: ${field}`);
  client.close();
}

main().catch((error: unknown) => {
  console.error(error);
  process.exit(1);
});
