#!/usr/bin/env bash
# The page's JavaScript against the types of the API: types.sh WORK URL, where WORK has the packages of tests/clients.
set -euo pipefail
page=$(cd "$(dirname "$0")/../../src/page" && pwd)
work=$1 url=$2
bin="$work/node_modules/.bin"

mkdir -p "$work/page"
cd "$work/page"
"$bin/openapi-typescript" "$url/openapi.json" --output slipdrive-api.d.ts
cat >tsconfig.json <<END
{
  "compilerOptions": {
    "strict": true, "allowJs": true, "checkJs": true, "noEmit": true, "noUnusedLocals": true, "noUnusedParameters": true,
    "target": "es2022", "module": "es2022", "moduleResolution": "bundler", "types": [],
    "lib": ["es2023", "dom", "dom.iterable", "dom.asynciterable"],
    "paths": { "slipdrive-api": ["$work/page/slipdrive-api.d.ts"] }
  },
  "include": ["$page/*.js"]
}
END
"$bin/tsc" -p tsconfig.json
