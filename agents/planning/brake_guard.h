#pragma once

#include "agents/sensing/road_view.h"

namespace lanewise {

/// The last check before a command is given. A plan counts on its course being steered as planned and on
/// others keeping their speed; where a neighbour comes to a stop, a turning body can still graze its corner.
/// @param leader the vehicle that is followed, which the planner keeps its distance from; kNone: none.
/// @param steering_angle [rad] and @param speed [m/s] that are about to be commanded.
/// @return true if the ego, which now touches nothing, would within the next step, the braking distance
/// behind it and a metre to turn away in touch something of the view that stands or walks: then it is time to
/// brake as hard as it can. Without the metre before vehicles once the ego has waited: it may be the ego that
/// is waited for. From 6 to 9 m/s it looks 0.3 s ahead instead, faster not at all. Under the agents' own
/// rules also what drives, in the view or not, and for a minute of waiting what is forgiven there; without
/// the metre.
bool MustBrakeNow(const World& world, AgentIndex ego, AgentIndex leader, const RoadView& view,
                  double steering_angle, double speed, double dt);

}  // namespace lanewise
