#!/usr/bin/env bash
# Makes a Python client from the OpenAPI document of a server and solves with it:
# openapi_python.sh WORK URL, where WORK has the packages of requirements.txt in WORK/venv.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$1 url=$2
# It looks for ruff on the path.
export PATH="$work/venv/bin:$PATH"

# A warning is a part of the document that it could not use.
openapi-python-client generate --url "$url/openapi.json" --meta none --output-path "$work/openapi_python/slipdrive_client" \
  --config "$here/openapi_python.yml" --fail-on-warning
PYTHONPATH="$work/openapi_python" python "$here/openapi_python.py" "$url"
