#!/usr/bin/env bash
# Makes a release of the commit that is checked out: version, changelog, checks, tag, crate, Python package, image, sums.
#   deploy/release.sh VERSION          dry: everything in a clone, nothing here is changed
#   deploy/release.sh VERSION --take   the same, then takes the clone's commit and tag over into this branch
# Nothing leaves the machine in either case: the last lines say what to push. The same commit and version give the same
# files.
#
# Needs git, cargo, cargo-deny (cargo install --locked cargo-deny), Python 3.10 or later with venv; for the image buildah
# (as root, or within `buildah unshare`), and the bases that the Dockerfile names, in local storage or within reach.
# Env: OUT (target/release-VERSION)   where the files go
#      CHECKS (full; short: neither .ci/run nor the manifests)
#      IMAGE (yes; no)  PULL (--pull-never to use local base images alone)  FEATURES (those of the Dockerfile)
#      ADVISORY_DB      a git clone of the RustSec database, at most 90 days old; without it no advisory is checked
set -euo pipefail
cd "$(dirname "$0")/.."
VERSION=${1:-} TAKE=${2:-} CHECKS=${CHECKS:-full} IMAGE=${IMAGE:-yes} PULL=${PULL:-} ADVISORY_DB=${ADVISORY_DB:-}
OUT=$(realpath -m "${OUT:-target/release-$VERSION}") TAG=v$VERSION HERE=$PWD
say() { printf '\n== %s\n' "$*"; }

refuse_what_cannot_be_released() {
    local faults=()
    [[ $VERSION =~ ^[0-9]+\.[0-9]+\.[0-9]+(-[0-9A-Za-z.]+)?$ ]] || faults+=("VERSION is '$VERSION', must be like 1.2.3")
    [[ -z $TAKE || $TAKE = --take ]] || faults+=("the second argument is '$TAKE', must be --take or nothing")
    [ -z "$(git status --porcelain)" ] || faults+=("the working tree has changes: commit or stash them")
    git rev-parse -q --verify "refs/tags/$TAG" >/dev/null && faults+=("the tag $TAG exists")
    for tool in cargo cargo-deny python3; do
        command -v "$tool" >/dev/null || faults+=("$tool is not installed")
    done
    [ "$IMAGE" = no ] || command -v buildah >/dev/null ||
        faults+=("buildah is not installed; IMAGE=no leaves the image out")
    [ ${#faults[@]} = 0 ] || {
        printf 'release.sh: %s\n' "${faults[@]}" >&2
        exit 64
    }
}

# A commit with the version, made of nothing but the last commit: run twice, it has the same hash.
commit_version() {
    git clone --quiet "$HERE" "$work/slipdrive"
    cd "$work/slipdrive"
    # Also what the Python build and buildah date their files with.
    SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
    export SOURCE_DATE_EPOCH
    python3 deploy/set-version.py "$VERSION" "$(date -u -d "@$SOURCE_DATE_EPOCH" +%F)" >"$OUT/NOTES.md"
    local of_last_commit=(-c "user.name=$(git log -1 --format=%cn)" -c "user.email=$(git log -1 --format=%ce)")
    export GIT_AUTHOR_DATE="@$SOURCE_DATE_EPOCH +0000" GIT_COMMITTER_DATE="@$SOURCE_DATE_EPOCH +0000"
    git "${of_last_commit[@]}" commit --quiet --all --no-gpg-sign --message "Release $VERSION"
    git "${of_last_commit[@]}" tag --annotate --no-sign --message "slipdrive $VERSION" "$TAG"
    git log -1 --format='%h %s'
}

check_dependencies() {
    cargo deny --locked check licenses bans sources
    if [ -n "$ADVISORY_DB" ]; then
        # Where cargo-deny looks for its clone of the default database.
        mkdir "$work/advisories"
        ln -s "$(realpath "$ADVISORY_DB")" "$work/advisories/advisory-db-3157b0e258782691"
        sed "s|^\[advisories\]|&\ndb-path = \"$work/advisories\"|" deny.toml >"$work/deny.toml"
        cargo deny --locked --offline --config "$work/deny.toml" check advisories
    else
        echo "skip  ADVISORY_DB names no database: advisories are not checked"
    fi
}

check_all() {
    if [ "$CHECKS" = full ]; then
        .ci/run
        deploy/check-manifests.sh
    else
        echo "skip  CHECKS=$CHECKS: neither .ci/run nor the manifests"
    fi
}

make_crate() {
    cargo publish --dry-run --locked
    # Where publishing leaves its file is its own affair.
    cargo package --locked --no-verify
    cp "${CARGO_TARGET_DIR:-target}/package/slipdrive-$VERSION.crate" "$OUT/"
}

make_python_package() {
    python3 -m venv "$work/venv"
    "$work/venv/bin/pip" install --quiet --disable-pip-version-check --requirement deploy/release-requirements.txt
    "$work/venv/bin/python" -m build --no-isolation --outdir "$OUT" clients/python
}

label_of() {
    buildah inspect --type image --format "{{index .Docker.Config.Labels \"org.opencontainers.image.$2\"}}" "$1"
}

make_image() {
    local image=localhost/slipdrive:$VERSION container mount
    [ "$IMAGE" = no ] && {
        echo "skip  IMAGE=no: no image, no bill of materials"
        return
    }
    # From scratch: cached layers would keep the labels and times of an older image.
    # shellcheck disable=SC2086 # PULL is a flag or nothing
    buildah build --no-cache --format docker --timestamp "$SOURCE_DATE_EPOCH" $PULL \
        ${FEATURES:+--build-arg "FEATURES=$FEATURES"} --build-arg "VERSION=$VERSION" \
        --build-arg "REVISION=$(git rev-parse HEAD)" --tag "$image" . >"$work/image.log" 2>&1 || {
        tail -30 "$work/image.log"
        return 1
    }
    [ "$(label_of "$image" revision) $(label_of "$image" version)" = "$(git rev-parse HEAD) $VERSION" ] || {
        echo "the labels of $image are not those of this release"
        return 1
    }
    # A folder that keeps its digest on the way to a registry: skopeo copy --preserve-digests dir:... docker://...
    rm -rf "$OUT/image"
    buildah push --quiet --compression-format gzip "$image" "dir:$OUT/image"
    deploy/strip-image.py "$OUT/image" >"$OUT/image.digest"
    container=$(buildah from --pull-never "$image")
    mount=$(buildah mount "$container")
    cp "$mount/usr/local/share/slipdrive/slipdrive.cdx.json" "$OUT/slipdrive-$VERSION.cdx.json"
    buildah rm "$container" >/dev/null
    # What the tags of the bases stood for.
    sed -nE 's/^FROM ([a-z.]+\/[^ ]+).*/\1/p' Dockerfile | while read -r base; do
        echo "$base $(buildah images --digests --format '{{.Digest}}' "$base" | head -1)"
    done >"$OUT/image.bases"
    echo "$image $(cat "$OUT/image.digest")"
}

sum_up() {
    cd "$OUT"
    find . -type f ! -name SHA256SUMS -printf '%P\n' | LC_ALL=C sort | xargs -d '\n' sha256sum >SHA256SUMS
    cat SHA256SUMS
}

take_over() {
    cd "$HERE"
    [ "$TAKE" = --take ] || {
        echo "dry: neither commit nor tag was taken over, see --take"
        return
    }
    git fetch --quiet "$work/slipdrive" "refs/tags/$TAG:refs/tags/$TAG"
    git merge --quiet --ff-only "$TAG^{commit}"
    echo "this branch is at $(git log -1 --format='%h %s'), tagged $TAG"
}

say_what_to_push() {
    cat <<EOF
git push origin HEAD $TAG
cargo publish --locked
twine upload $OUT/slipdrive-$VERSION-py3-none-any.whl $OUT/slipdrive-$VERSION.tar.gz
EOF
    [ "$IMAGE" = no ] || echo "skopeo copy --preserve-digests dir:$OUT/image docker://REGISTRY/slipdrive:$VERSION"
}

# A function, so that all of this is read before any of it runs: taking a release over may rewrite this file.
release() {
    refuse_what_cannot_be_released
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    rm -rf "$OUT"
    mkdir -p "$OUT"
    say "version and changelog"
    commit_version
    say "dependencies"
    check_dependencies
    say "checks"
    check_all
    say "crate"
    make_crate
    say "Python package"
    make_python_package
    say "image"
    make_image
    say "files in $OUT"
    sum_up
    say "commit and tag"
    take_over
    say "left to do, by hand"
    say_what_to_push
}
release
exit
