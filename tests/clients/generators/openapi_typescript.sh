#!/usr/bin/env bash
# Makes TypeScript types from the OpenAPI document of a server, compiles a program with them and solves with it:
# openapi_typescript.sh WORK URL, where WORK has the packages of package.json.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$1 url=$2
bin="$work/node_modules/.bin"

mkdir -p "$work/openapi_typescript"
cp "$here/openapi_typescript.ts" "$work/openapi_typescript"
cd "$work/openapi_typescript"
"$bin/openapi-typescript" "$url/openapi.json" --output slipdrive.ts
"$bin/tsc" --strict --skipLibCheck --target es2022 --module node16 --types node openapi_typescript.ts
node openapi_typescript.js "$url"
