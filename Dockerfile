# The service as a small image: no shell, no package manager, no root, nothing to write to.
#   docker build -t slipdrive .
#   docker run --rm -p 8080:8080 -p 50051:50051 -e SLIPDRIVE_ALLOW_UNAUTHENTICATED=true slipdrive
# A server that others can reach wants API keys; the variable says that something in front of it checks callers.

FROM docker.io/library/rust:1.95-bookworm AS build
# Optional parts; `otel` exports spans where OTEL_EXPORTER_OTLP_ENDPOINT is set, and does nothing elsewhere; `nats` is for sweeps.
ARG FEATURES=otel,nats
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

FROM gcr.io/distroless/cc-debian12:nonroot
ARG VERSION=0.1.0
ARG REVISION=unknown
LABEL org.opencontainers.image.title="slipdrive" \
      org.opencontainers.image.description="Time-optimal maneuvers of a differential-drive robot whose wheels stick or slip" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0" \
      org.opencontainers.image.version="$VERSION" \
      org.opencontainers.image.revision="$REVISION"
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
