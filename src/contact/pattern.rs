//! Contact patterns: which contacts stick, and which way a single slipping wheel slips.

use super::directions::sticking;

/// Whether a contact sticks (no slip, impulse inside its friction disc) or slips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactMode {
    /// No slip.
    Stick,
    /// Slip; also a contact without friction or without normal force.
    #[default]
    Slip,
}

impl ContactMode {
    /// `stick` or `slip`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Stick => "stick",
            Self::Slip => "slip",
        }
    }
}

/// Way in which a wheel slips lengthwise while the other one sticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SlipSign {
    /// The contact point slides backwards: negative longitudinal slip, as when accelerating.
    Backward,
    /// The wheel has no normal force, hence no friction.
    NoNormalForce,
    /// The contact point slides forwards, as when braking.
    Forward,
}

impl SlipSign {
    /// Of a wheel's longitudinal slip and normal impulse.
    pub(super) fn of(slip: f64, normal_impulse: f64) -> Self {
        if normal_impulse <= 0.0 {
            Self::NoNormalForce
        } else if slip < 0.0 {
            Self::Backward
        } else {
            Self::Forward
        }
    }

    /// -1, 0 or 1.
    pub const fn value(self) -> f64 {
        match self {
            Self::Backward => -1.0,
            Self::NoNormalForce => 0.0,
            Self::Forward => 1.0,
        }
    }
}

/// Modes of the two wheels. Both share one lateral slip: when one sticks, the other slips purely lengthwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WheelPattern {
    /// Both wheels stick.
    #[default]
    BothStick,
    /// The left wheel sticks, the right one slips.
    RightSlips(SlipSign),
    /// The right wheel sticks, the left one slips.
    LeftSlips(SlipSign),
    /// Both wheels slip.
    BothSlip,
}

/// Modes of all contacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ContactPattern {
    /// Modes of the wheels.
    pub wheels: WheelPattern,
    /// Mode of the front support; `Slip` when it has no friction.
    pub front: ContactMode,
}

impl WheelPattern {
    /// The patterns in which the friction problem is linear (with a sticking or frictionless front support).
    pub const LINEAR: [Self; 7] = [
        Self::BothStick,
        Self::RightSlips(SlipSign::Forward),
        Self::RightSlips(SlipSign::Backward),
        Self::LeftSlips(SlipSign::Forward),
        Self::LeftSlips(SlipSign::Backward),
        Self::RightSlips(SlipSign::NoNormalForce),
        Self::LeftSlips(SlipSign::NoNormalForce),
    ];

    /// The pattern of wheels (left, right) of which some stick; `sign` gives the way of one that slips alone.
    pub(super) fn of_sticking(sticks: [bool; 2], sign: impl Fn(usize) -> SlipSign) -> Self {
        match sticks {
            [true, true] => Self::BothStick,
            [true, false] => Self::RightSlips(sign(1)),
            [false, true] => Self::LeftSlips(sign(0)),
            [false, false] => Self::BothSlip,
        }
    }

    /// The pattern's place in [`WheelPattern::LINEAR`]; none while both wheels slip.
    pub const fn linear_index(self) -> Option<usize> {
        match self {
            Self::BothStick => Some(0),
            Self::RightSlips(SlipSign::Forward) => Some(1),
            Self::RightSlips(SlipSign::Backward) => Some(2),
            Self::LeftSlips(SlipSign::Forward) => Some(3),
            Self::LeftSlips(SlipSign::Backward) => Some(4),
            Self::RightSlips(SlipSign::NoNormalForce) => Some(5),
            Self::LeftSlips(SlipSign::NoNormalForce) => Some(6),
            Self::BothSlip => None,
        }
    }
}

impl ContactPattern {
    /// Every contact slips.
    pub const ALL_SLIP: Self = Self { wheels: WheelPattern::BothSlip, front: ContactMode::Slip };

    /// Modes of left wheel, right wheel and front support.
    pub const fn modes(self) -> [ContactMode; 3] {
        let (left, right) = match self.wheels {
            WheelPattern::BothStick => (ContactMode::Stick, ContactMode::Stick),
            WheelPattern::RightSlips(_) => (ContactMode::Stick, ContactMode::Slip),
            WheelPattern::LeftSlips(_) => (ContactMode::Slip, ContactMode::Stick),
            WheelPattern::BothSlip => (ContactMode::Slip, ContactMode::Slip),
        };
        [left, right, self.front]
    }

    /// 5 - rank of the sticking directions.
    pub fn degrees_of_freedom(self) -> u8 {
        5 - sticking::<5>(self).map(u8::from).iter().sum::<u8>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_of_freedom_are_those_of_the_paper() {
        let dof = |wheels| ContactPattern { wheels, front: ContactMode::Slip }.degrees_of_freedom();
        assert_eq!(dof(WheelPattern::BothStick), 2);
        assert_eq!(dof(WheelPattern::RightSlips(SlipSign::Forward)), 3);
        assert_eq!(dof(WheelPattern::LeftSlips(SlipSign::Backward)), 3);
        assert_eq!(dof(WheelPattern::BothSlip), 5);
    }

    #[test]
    fn linear_index_points_at_itself() {
        for (index, wheels) in WheelPattern::LINEAR.into_iter().enumerate() {
            assert_eq!(wheels.linear_index(), Some(index));
        }
    }
}
