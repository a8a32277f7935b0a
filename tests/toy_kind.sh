#!/usr/bin/env bash
# One more kind of job is one more folder: applies toy_kind.patch to a copy of the sources, builds it, and tries the kind
# everywhere. tests/toy_kind.sh PYTHON [FLAG of cargo]..., where PYTHON has the packages of clients/requirements.txt.
set -euo pipefail
cd "$(dirname "$0")/.."
python=$1
shift

patch=tests/toy_kind.patch
files=$(grep -c '^+++ ' "$patch")
lines=$(grep '^+' "$patch" | grep -cv '^+++ ')
if [ "$files" -gt 4 ] || [ "$lines" -gt 100 ]; then
  echo "a kind of job takes $files files and $lines lines"
  exit 1
fi

target=$(realpath "${CARGO_TARGET_DIR:-target}")
copy=$(mktemp -d)
server=
finish() {
  if [ -n "$server" ]; then kill "$server" 2>/dev/null || true; fi
  rm -rf "$copy"
}
trap finish EXIT
git ls-files -z | xargs -0 cp --parents -t "$copy"
cd "$copy"
git apply "$patch"
# The dependencies are those of the build before; the numerics need not be fast.
cargo --config profile.dev.opt-level=0 build --locked --target-dir "$target" "$@" --bin slipdrive
program="$target/debug/slipdrive"

echo '{"robot": {"wheel_friction_coefficient": 0.5, "gravity_m_s2": 10}}' >robot.json
"$program" envelope robot.json | grep -x 'acceleration 5.000 m/s2'
"$program" envelope --json - robot.json | grep -x '{"acceleration_m_s2":5.0}'
"$program" --help | grep 'envelope  *Gives the acceleration that friction allows'

"$program" serve --http 127.0.0.1:0 --grpc 127.0.0.1:0 --workers 1 --queue-length 0 --log-format json 2>log &
server=$!
for _ in $(seq 100); do
  grep -q '"listening"' log && break
  sleep 0.1
done
address_of() { sed -n "s/.*\"$1\":\"\([^\"]*\)\".*/\1/p" log | head -1; }
"$python" tests/toy_kind.py "http://$(address_of http.address)" "$(address_of grpc.address)"
