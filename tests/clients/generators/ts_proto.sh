#!/usr/bin/env bash
# Makes TypeScript from proto/ with ts-proto, compiles a program with it and calls a server, as proto/README.md says:
# ts_proto.sh WORK HOST:PORT, where WORK has the packages of package.json, and those of requirements.txt in WORK/venv.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$1 address=$2
bin="$work/node_modules/.bin" python="$work/venv/bin/python"
# Where googleapis-common-protos has google/rpc/error_details.proto.
packages=$("$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')

mkdir -p "$work/ts_proto"
cp "$here/ts_proto.ts" "$work/ts_proto"
(
  cd "$here/../../../proto"
  "$python" -m grpc_tools.protoc -I . -I "$packages" --plugin="$bin/protoc-gen-ts_proto" --ts_proto_out="$work/ts_proto" \
    --ts_proto_opt=outputServices=grpc-js,env=node,esModuleInterop=true,snakeToCamel=false \
    slipdrive/v1/*.proto google/rpc/status.proto google/rpc/error_details.proto
)
cd "$work/ts_proto"
"$bin/tsc" --strict --skipLibCheck --target es2022 --module node16 --types node ts_proto.ts
node ts_proto.js "$address"
