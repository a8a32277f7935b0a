#!/usr/bin/env bash
# Makes Python stubs from proto/ and calls a server with them, as proto/README.md says:
# grpcio_tools.sh WORK HOST:PORT, where WORK has the packages of requirements.txt in WORK/venv.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$1 address=$2
python="$work/venv/bin/python"

mkdir -p "$work/grpcio_tools"
(
  cd "$here/../../../proto"
  "$python" -m grpc_tools.protoc -I . --python_out="$work/grpcio_tools" --pyi_out="$work/grpcio_tools" \
    --grpc_python_out="$work/grpcio_tools" slipdrive/v1/*.proto
)
PYTHONPATH="$work/grpcio_tools" "$python" "$here/grpcio_tools.py" "$address"
