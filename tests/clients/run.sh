#!/usr/bin/env bash
# The page in a browser, the package for Python, clients that nobody here wrote, clients that generators made, and the
# examples, against a running server. Needs Python 3.11 with venv, npm, curl and chromium; what they need beside is installed
# into a temporary folder. Flags are those of the `cargo test` before, so that nothing is built twice:
# tests/clients/run.sh [--all-features]
set -euo pipefail
cd "$(dirname "$0")/../.."

# With the example, the dependencies are those of the tests.
cargo build --locked "$@" --bin slipdrive --example grpc_client
built="${CARGO_TARGET_DIR:-target}/debug"
work=$(mktemp -d)
server=
finish() {
  kill $(jobs -p) 2>/dev/null || true
  rm -rf "$work"
}
trap finish EXIT

# step NAME COMMAND...: one line when it goes well, all of its output when it does not. The timeout is against hangs alone: the
# slowest step takes minutes on a busy machine.
step() {
  local name=$1 begin=$SECONDS
  output="$work/output-$BASHPID"
  shift
  if timeout 900 "$@" >"$output" 2>&1; then
    echo "ok      $name ($((SECONDS - begin)) s)"
  else
    local code=$?
    cat "$output"
    echo "FAILED  $name: exit code $code of: $*"
    exit 1
  fi
}

# holds TEXT COMMAND...: the command succeeds and says so.
holds() {
  local text=$1
  shift
  "$@" | tee "$work/said"
  grep -q -- "$text" "$work/said" || { echo "\`$text\` is missing in the output"; return 1; }
}
export -f holds
export work

# serve FLAG...: a server on free ports; sets $rest and $grpc.
serve() {
  if [ -n "$server" ]; then kill "$server" && wait "$server" || true; fi
  # Emptied here, else the last server's addresses might be read before the new one writes its own; appended to, since the server of
  # schemathesis goes on writing.
  : >"$work/log"
  "$built/slipdrive" serve --http 127.0.0.1:0 --grpc 127.0.0.1:0 --log-format json "$@" 2>>"$work/log" &
  server=$!
  for _ in $(seq 100); do
    grep -q '"listening"' "$work/log" && break
    kill -0 "$server" 2>/dev/null || { cat "$work/log"; echo "FAILED  the server does not start"; exit 1; }
    sleep 0.1
  done
  address_of() { sed -n "s/.*\"$1\":\"\([^\"]*\)\".*/\1/p" "$work/log" | head -1; }
  rest="http://$(address_of http.address)"
  grpc=$(address_of grpc.address)
}

step "python packages" bash -c "python3 -m venv '$work/venv' && '$work/venv/bin/pip' install -q --no-compile -r tests/clients/requirements.txt"
cp tests/clients/package.json "$work"
step "npm packages" npm install --silent --no-audit --no-fund --no-package-lock --prefix "$work"
python="$work/venv/bin/python"
buf="$work/node_modules/.bin/buf"

step "buf lint" "$buf" lint proto
step "buf breaking" "$buf" breaking proto --against tests/data/proto_v1.binpb

# One core for minutes, and a server of its own: beside all that follows.
serve
server=
step "schemathesis" "$work/venv/bin/schemathesis" --config-file tests/schemathesis.toml run "$rest/openapi.json" \
  --max-examples 50 --seed 1 --no-color &
fuzzing=$!

package() {
  "$work/venv/bin/python" -m build --no-isolation --outdir "$work/dist" clients/python
  "$work/venv/bin/pip" install -q "$(echo "$work"/dist/*.whl)[pandas]"
}
export -f package
step "clients/python: types" "$python" clients/python/make_types.py --check
step "clients/python: sdist and wheel" bash -euc package
# These start servers of their own, and kill some of them.
step "clients/python: tests" env SLIPDRIVE_PROGRAM="$(realpath "$built/slipdrive")" PYTHONDONTWRITEBYTECODE=1 \
  "$python" -m pytest -p no:cacheprovider clients/python
step "clients/python: mypy" bash -c "cd clients/python && $work/venv/bin/mypy --cache-dir '$work/mypy'"

# Servers of its own too.
step "the page in a browser" "$python" tests/page/check.py "$built/slipdrive" "$work/node_modules/axe-core/axe.min.js"
grep -v '^ok' "$output" || true

serve
step "the page's types" tests/page/types.sh "$work" "$rest"
step "examples/curl.sh" bash -c "holds '\"code\":\"invalid_value\"' examples/curl.sh $rest"
step "examples/fleet_planner.py" bash -c "holds 'robot-7: .* s, STATUS_' $python examples/fleet_planner.py $grpc"
step "examples/grpc_client.rs" bash -c "holds 'STATUS_CONVERGED: ' $built/examples/grpc_client http://$grpc"
step "exports" "$python" tests/clients/export.py "$rest"
step "reflection, health and rich errors" "$python" tests/clients/probe.py "$grpc"
generators=tests/clients/generators
step "openapi-python-client" "$generators/openapi_python.sh" "$work" "$rest"
step "openapi-typescript" "$generators/openapi_typescript.sh" "$work" "$rest"
step "grpcio-tools" "$generators/grpcio_tools.sh" "$work" "$grpc"
step "ts-proto" "$generators/ts_proto.sh" "$work" "$grpc"

SLIPDRIVE_API_KEYS=secret serve --one-port
step "one port with keys: curl" env CURL_KEY=secret bash -c "holds 'event: result' examples/curl.sh $rest"
step "one port with keys: gRPC" "$python" tests/clients/probe.py "${rest#http://}" secret
step "no key" bash -c "! examples/curl.sh $rest"
wait "$fuzzing"
# Last, since it puts another program in the place of this one.
step "a toy kind of job" tests/toy_kind.sh "$python" "$@"
echo "all clients are content"
