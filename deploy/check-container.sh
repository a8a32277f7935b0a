#!/usr/bin/env bash
# Builds the image and runs it as a hardened pod would: no root, nothing to write to, no capabilities, seccomp, 256 MB.
# One line a check; exit 1 if one fails, 77 (as test suites skip) when buildah or podman is missing.
#
# Needs, as root: buildah, podman, runc, catatonit, curl, openssl, python3, iproute2, util-linux; the base images that the Dockerfile
# names, in local storage or within reach.
# Env: IMAGE (localhost/slipdrive)  MEMORY (256m)  MAX_MB (48)  PULL (--pull-never to use local base images alone)
#      BUILD (yes; no: checks the image as it is)
set -uo pipefail
cd "$(dirname "$0")/.."
IMAGE=${IMAGE:-localhost/slipdrive} MEMORY=${MEMORY:-256m} MAX_MB=${MAX_MB:-48} PULL=${PULL:-} BUILD=${BUILD:-yes}
for tool in buildah podman; do
    command -v "$tool" >/dev/null || {
        echo "skip  $tool is not installed: the container is not checked"
        exit 77
    }
done

work=$(mktemp -d) name=slipdrive-check-$$ probe=slipdrive-probe-$$
faults=0
cat >"$work/containers.conf" <<CONF
[containers]
default_ulimits = ["nofile=$(ulimit -Hn):$(ulimit -Hn)", "nproc=4096:4096"]
[engine]
cgroup_manager = "cgroupfs"
runtime = "runc"
events_logger = "file"
CONF
export CONTAINERS_CONF=$work/containers.conf
clean() {
    podman rm -f -t 0 "$name" "$name-bare" "$name-tls" >/dev/null 2>&1
    ip netns del "$probe" 2>/dev/null
    rm -rf "$work"
}
trap clean EXIT
ok() { echo "ok    $*"; }
fault() {
    faults=$((faults + 1))
    echo "FAIL  $*"
}
is() { if [ "$2" = "$3" ]; then ok "$1 ($2)"; else fault "$1: $2, want $3"; fi; }
at_most() { if [ "$2" -le "$3" ]; then ok "$1 ($2, at most $3)"; else fault "$1: $2, at most $3"; fi; }

if [ "$BUILD" = yes ]; then
    # shellcheck disable=SC2086 # PULL is a flag or nothing
    buildah bud --layers --isolation chroot --format docker $PULL -t "$IMAGE" . >"$work/build.log" 2>&1 || {
        tail -30 "$work/build.log"
        fault "the image builds"
        exit 1
    }
    ok "the image builds"
fi
of_image() { podman image inspect -f "$1" "$IMAGE"; }
case $(of_image '{{.Config.User}}') in [1-9]*) ok "the user is a number other than 0" ;; *) fault "the user" ;; esac
at_most "size in MB" $(($(of_image '{{.Size}}') / 1000000)) "$MAX_MB"
is "entry point" "$(of_image '{{json .Config.Entrypoint}}')" '["/usr/local/bin/slipdrive"]'

podman run --rm --name "$name-bare" --network none "$IMAGE" >"$work/bare.log" 2>&1
is "a public server without keys does not start" $? 64

run=(podman run -d --name "$name" --network none --read-only --cap-drop ALL --security-opt no-new-privileges
    --memory "$MEMORY" --cpus 1 --pids-limit 128 --health-interval disable
    -e SLIPDRIVE_ALLOW_UNAUTHENTICATED=true -e SLIPDRIVE_ADMIN=0.0.0.0:9090 -e SLIPDRIVE_QUEUE_LENGTH=16
    -e SLIPDRIVE_DRAIN_TIMEOUT_S=60 "$IMAGE")
"${run[@]}" >"$work/id" 2>"$work/run.log" || {
    cat "$work/run.log"
    fault "the container starts"
    exit 1
}
pid=$(podman inspect -f '{{.State.Pid}}' "$name")
inside() { nsenter -t "$pid" -n curl -s -m 60 "$@"; }
code() { "$@" -o /dev/null -w '%{http_code}'; }
for _ in $(seq 150); do
    [ "$(code inside http://127.0.0.1:9090/readyz)" = 200 ] && break
    sleep 0.1
done
is "ready, asked from within its network" "$(code inside http://127.0.0.1:9090/readyz)" 200
is "metrics are on the admin port alone" "$(code inside http://127.0.0.1:8080/metrics)" 404
of_process() { awk -v key="$1:" '$1 == key { print $2 }' "/proc/$pid/status"; }
is "user id" "$(of_process Uid)" 65532
is "capabilities" "$(of_process CapEff)" 0000000000000000
is "no new privileges" "$(of_process NoNewPrivs)" 1
is "seccomp filter" "$(of_process Seccomp)" 2
is "root file system" "$(awk '$5 == "/" { split($6, option, ","); print option[1] }' "/proc/$pid/mountinfo")" ro
podman exec "$name" /usr/local/bin/slipdrive health >/dev/null 2>&1
is "the health command, inside" $? 0
of_image '{{json .Config.Healthcheck.Test}}' | grep -q '"CMD","/usr/local/bin/slipdrive","health"' &&
    ok "the HEALTHCHECK is that command" || fault "the HEALTHCHECK is $(of_image '{{json .Config.Healthcheck.Test}}')"

# TLS without an admin port: the health command finds out by itself.
mkdir "$work/tls"
openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 1 -subj /CN=localhost \
    -addext subjectAltName=DNS:localhost -keyout "$work/tls/key.pem" -out "$work/tls/chain.pem" 2>"$work/openssl.log"
chown -R 65532 "$work/tls"
chmod 711 "$work"
podman run -d --name "$name-tls" --network none --read-only --cap-drop ALL --health-interval disable \
    -v "$work/tls:/tls:ro" -e SLIPDRIVE_TLS_CERTIFICATE=/tls/chain.pem -e SLIPDRIVE_TLS_KEY=/tls/key.pem \
    -e SLIPDRIVE_ALLOW_UNAUTHENTICATED=true "$IMAGE" >/dev/null 2>"$work/tls.log" || cat "$work/tls.log"
for _ in $(seq 50); do
    podman healthcheck run "$name-tls" >/dev/null 2>&1 && break
    sleep 0.2
done
podman healthcheck run "$name-tls" >/dev/null 2>&1
is "the HEALTHCHECK with TLS and no admin port" $? 0
tls_pid=$(podman inspect -f '{{.State.Pid}}' "$name-tls")
is "ready over TLS" "$(nsenter -t "$tls_pid" -n curl -s -m 10 -o /dev/null -w '%{http_code}' --cacert "$work/tls/chain.pem" \
    https://localhost:8080/readyz)" 200
podman rm -f -t 0 "$name-tls" >/dev/null 2>&1
podman cp "$name:/usr/local/share/slipdrive/slipdrive.cdx.json" "$work/bill.json" 2>"$work/cp.log" || cat "$work/cp.log"
is "the bill of materials is CycloneDX and names tokio" "$(python3 -c 'import json, sys
bill = json.load(open(sys.argv[1]))
print(bill["bomFormat"], "tokio" in [part["name"] for part in bill["components"]])' "$work/bill.json" 2>&1)" "CycloneDX True"

# A second network namespace with a cable to the first: what is bound to all addresses is reached from outside.
if ip netns add "$probe" && ip link add "sd$$a" type veth peer name "sd$$b"; then
    ip link set "sd$$a" netns "$pid" && ip link set "sd$$b" netns "$probe"
    nsenter -t "$pid" -n sh -c "ip addr add 10.213.7.1/30 dev sd$$a; ip link set sd$$a up"
    ip netns exec "$probe" sh -c "ip addr add 10.213.7.2/30 dev sd$$b; ip link set sd$$b up"
    outside() { ip netns exec "$probe" curl -s -m 60 "$@"; }
    is "ready, asked from another network" "$(code outside http://10.213.7.1:9090/readyz)" 200
    is "a solve, asked from another network" "$(code outside http://10.213.7.1:8080/solve \
        -H 'content-type: application/json' -d '{"maneuver": {"goal": {"y_m": 1}}, "solver": {"starts": 1}, "view": "plan"}')" 200
    is "the gRPC port, asked from another network" "$(ip netns exec "$probe" \
        python3 -c 'import socket; socket.create_connection(("10.213.7.1", 50051), 5); print("open")' 2>&1 | tail -1)" open
else
    fault "a second network namespace cannot be made"
fi

# Load: more callers than places, the largest answers, each caller until it has had its share.
load() {
    for _ in $(seq 6); do
        code inside http://127.0.0.1:8080/solve -H 'content-type: application/json' \
            -d "{\"maneuver\": {\"goal\": {\"y_m\": $1}}, \"grid\": {\"steps\": 2000}, \"solver\": {\"starts\": 1, \"time_limit_s\": 1}}"
        echo
    done
}
callers=()
for caller in $(seq 24); do
    load "$caller" >"$work/load.$caller" &
    callers+=($!)
done
wait "${callers[@]}"
is "statuses under load" "$(cat "$work"/load.* | sort -u | tr '\n' ' ')" "200 429 "
ok "answered $(cat "$work"/load.* | grep -c 200) of 144 posts, the others refused for want of room"
cgroup=/sys/fs/cgroup$(awk -F: '$1 == 0 { print $3 }' "/proc/$pid/cgroup")
peak=$(cat "$cgroup/memory.peak" 2>/dev/null || cat "/sys/fs/cgroup/memory$(awk -F: '/memory/ { print $3 }' "/proc/$pid/cgroup")/memory.max_usage_in_bytes")
at_most "peak of the container's memory in MB, of $MEMORY" $((${peak:-0} / 1000000)) 256
at_most "peak of the process's memory in kB" "$(of_process VmHWM)" 262144

# A stop with solves in flight: they are answered.
for caller in 1 2 3; do
    code inside http://127.0.0.1:8080/solve -H 'content-type: application/json' \
        -d '{"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 2000}, "solver": {"starts": 64, "time_limit_s": 2}}' >"$work/last.$caller" &
done
for _ in $(seq 100); do
    inside http://127.0.0.1:9090/metrics | grep -q '^slipdrive_queue_depth 2$' && break
    sleep 0.05
done
begin=$(date +%s%N)
podman stop -t 75 "$name" >/dev/null 2>&1
ms=$((($(date +%s%N) - begin) / 1000000))
wait
is "solves in flight and waiting at SIGTERM" "$(cat "$work"/last.*)" 200200200
is "exit code, $ms ms after SIGTERM" "$(podman inspect -f '{{.State.ExitCode}}' "$name")" 0
is "killed for memory" "$(podman inspect -f '{{.State.OOMKilled}}' "$name")" false
echo "$faults failed"
[ "$faults" = 0 ]
