#pragma once

#include "agents/planning/dwa.h"

namespace lanewise {

/// Is the ego so long, and its bend so tight or the ego so far turned from its path, that what its body
/// sweeps cannot be told from where its bumpers are across the path?
bool SweepsAcross(const RoadView& view, const PlanContext& context);

/// Like LimitCourseSpeeds, for the obstacles whose `body` is known: each course is driven in the world, and
/// the bodies' boxes are compared. A course is free as far as nothing comes nearer than `margin` [m], or than
/// it is now.
void LimitBySweep(const AgentParams& params, const RoadView& view, const PlanContext& context, float margin,
                  CourseSet* courses);

}  // namespace lanewise
