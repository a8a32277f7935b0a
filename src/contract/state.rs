//! States, goals and trajectories: messages with one field per component of the state.

use super::message;
use crate::robot::State;
use crate::simulation::Trajectory;

/// What is made of the ten components of a state, in the order of [`State::to_vector`].
macro_rules! by_component {
    ($($field:ident),* $(,)?) => {
        impl From<message::State> for State {
            fn from(given: message::State) -> Self {
                let message::State { $($field),* } = given;
                Self::from_vector(&[$($field),*].into())
            }
        }

        impl From<message::EndState> for State {
            fn from(said: message::EndState) -> Self {
                let message::EndState { $($field),* } = said;
                Self::from_vector(&[$($field),*].into())
            }
        }

        impl From<&State> for message::State {
            fn from(state: &State) -> Self {
                let [$($field),*] = state.to_vector().into();
                Self { $($field),* }
            }
        }

        impl From<&State> for message::EndState {
            fn from(state: &State) -> Self {
                let [$($field),*] = state.to_vector().into();
                Self { $($field),* }
            }
        }

        impl From<&Trajectory> for message::Trajectory {
            fn from(trajectory: &Trajectory) -> Self {
                let mut columns = Self { time_s: trajectory.time.clone(), ..Self::default() };
                for state in &trajectory.state {
                    let message::State { $($field),* } = state.into();
                    $(columns.$field.push($field);)*
                }
                columns
            }
        }

        /// The components that a goal gives.
        pub(super) fn values_of_goal(goal: &message::Goal) -> [Option<f64>; State::LEN] {
            [$(goal.$field),*]
        }

        /// A goal of these components, with the names of the others.
        pub(super) fn goal_of_values([$($field),*]: [Option<f64>; State::LEN], free: Vec<String>) -> message::Goal {
            message::Goal { $($field,)* free }
        }
    };
}

by_component!(
    x_m,
    y_m,
    heading_rad,
    wheel_angle_left_rad,
    wheel_angle_right_rad,
    velocity_x_m_s,
    velocity_y_m_s,
    yaw_rate_rad_s,
    wheel_rate_left_rad_s,
    wheel_rate_right_rad_s,
);
