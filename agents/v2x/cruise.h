#pragma once

#include "agents/agent_params.h"
#include "agents/planning/tactics.h"
#include "agents/sensing/road_view.h"
#include "agents/v2x/message.h"

namespace lanewise {

/// Cooperative adaptive cruise: following closer than a driver would, because the leader tells what it is
/// about to do.
struct Cruise {
  StationId follows{kNone};  ///< The leader, while its messages are fresh; kNone: ordinary following.
  double accel{0.0};         ///< [m/s^2] asked for; with a leader only.
  double leader_decel{0.0};  ///< [m/s^2] the leader may brake with, as it says; likewise.
  double time_gap{0.0};  ///< [s] that ordinary following keeps: short after a platoon dissolved, then longer.
};

/// Joins the leader on the way if both carry radios, its last message is fresh and it is near enough; leaves
/// it otherwise. The controller is Ploeg's: u' = (-u + k_p e + k_d e' + u_leader) / h with the spacing error
/// e against standstill gap + h v (Ploeg, van de Wouw, Nijmeijer: Lp string stability of cascaded systems,
/// IEEE Trans. Control Systems Technology 22(2), 2014, Eq. 8), the leader's planned acceleration carried on
/// over its message's age at the rate the message tells.
Cruise DecideCruise(const World& world, const V2xParams& params, AgentIndex ego, const Leader& leader,
                    const Tactics& tactics, double dt);

}  // namespace lanewise
