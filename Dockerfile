# The service as a small image: no shell, no package manager, no root, nothing to write to.
#   docker build -t slipdrive .
#   docker run --rm -p 127.0.0.1:8080:8080 -p 127.0.0.1:50051:50051 -e SLIPDRIVE_ALLOW_UNAUTHENTICATED=true slipdrive
# A server that others can reach wants API keys; the variable says that something in front of it checks callers.

# Optional parts; each does nothing where it is not configured: `otel` exports spans where OTEL_EXPORTER_OTLP_ENDPOINT is set,
# `tls` speaks TLS where there is a certificate, `nats` is for workers of sweeps.
ARG FEATURES=nats,otel,tls

FROM docker.io/library/rust:1.95.0-bookworm AS toolchain

# What is in the program, as CycloneDX: the packages of Cargo.lock that these features compile for Linux.
FROM toolchain AS bill
ARG CYCLONEDX=0.5.9
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    cargo install --debug --locked --root /usr/local "cargo-cyclonedx@$CYCLONEDX"
WORKDIR /build
COPY Cargo.toml Cargo.lock ./
COPY benches benches
ARG FEATURES
# With a fixed time the bill has no serial number: the same sources give the same bytes.
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    mkdir src && touch src/main.rs src/lib.rs build.rs \
    && SOURCE_DATE_EPOCH=0 cargo cyclonedx --format json --spec-version 1.5 --features "$FEATURES" \
       --target x86_64-unknown-linux-gnu --no-build-deps --override-filename slipdrive.cdx

FROM toolchain AS build
ARG FEATURES
WORKDIR /build
# The dependencies in a layer of their own: it is built again only when they change.
COPY Cargo.toml Cargo.lock build.rs ./
COPY build build
COPY proto proto
COPY benches benches
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    mkdir src && echo 'fn main() {}' > src/main.rs && touch src/lib.rs \
    && cargo build --release --locked --features "$FEATURES" --bin slipdrive \
    && rm -r src
COPY src src
# Newer than what was built of the empty sources.
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    touch src/main.rs src/lib.rs \
    && cargo build --release --locked --features "$FEATURES" --bin slipdrive \
    && strip target/release/slipdrive

# Its tags move; the release notes the digest. To pin it:
# --build-context gcr.io/distroless/cc-debian12:nonroot=docker-image://gcr.io/distroless/cc-debian12@sha256:...
FROM gcr.io/distroless/cc-debian12:nonroot
ARG VERSION=0.1.0
ARG REVISION=unknown
LABEL org.opencontainers.image.title="slipdrive" \
      org.opencontainers.image.description="Time-optimal maneuvers of a differential-drive robot whose wheels stick or slip" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0" \
      org.opencontainers.image.version="$VERSION" \
      org.opencontainers.image.revision="$REVISION"
COPY LICENSE-MIT LICENSE-APACHE /usr/local/share/slipdrive/
COPY --from=bill /build/slipdrive.cdx.json /usr/local/share/slipdrive/
COPY --from=build /build/target/release/slipdrive /usr/local/bin/slipdrive
ENV SLIPDRIVE_HTTP=0.0.0.0:8080 \
    SLIPDRIVE_GRPC=0.0.0.0:50051 \
    SLIPDRIVE_LOG_FORMAT=json
# By number, so that `runAsNonRoot` can be checked without a look into the image.
USER 65532:65532
EXPOSE 8080 50051
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=5s --start-period=5s --retries=3 CMD ["/usr/local/bin/slipdrive", "health"]
ENTRYPOINT ["/usr/local/bin/slipdrive"]
CMD ["serve"]
