// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/robot/free_move.hpp"

#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/goals/GoalState.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/base/terminationconditions/IterationTerminationCondition.h>
#include <ompl/datastructures/NearestNeighborsLinear.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>

#include <algorithm>
#include <cmath>

#include "planner/base/random.hpp"

namespace asbuilt {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;
using Space = ob::RealVectorStateSpace;

/// Uniform inside the bounds, from our own generator: OMPL's is seeded once for the whole process.
class FixedSampler : public ob::StateSampler {
 public:
  explicit FixedSampler(const ob::StateSpace* space) : ob::StateSampler(space), random_(Random::stream(41, "free move")) {}
  void sampleUniform(ob::State* state) override {
    const auto& b = space_->as<Space>()->getBounds();
    for (unsigned i = 0; i < 6; ++i) (*state->as<Space::StateType>())[i] = random_.uniform(b.low[i], b.high[i]);
  }
  void sampleUniformNear(ob::State* state, const ob::State* near, double distance) override {
    for (unsigned i = 0; i < 6; ++i) (*state->as<Space::StateType>())[i] = (*near->as<Space::StateType>())[i] + random_.uniform(-distance, distance);
    space_->enforceBounds(state);
  }
  void sampleGaussian(ob::State* state, const ob::State* mean, double sd) override {
    for (unsigned i = 0; i < 6; ++i) (*state->as<Space::StateType>())[i] = random_.normal((*mean->as<Space::StateType>())[i], sd);
    space_->enforceBounds(state);
  }

 private:
  Random random_;
};

JointVector joints_of(const ob::State* state) {
  JointVector q;
  for (unsigned i = 0; i < 6; ++i) q[i] = (*state->as<Space::StateType>())[i];
  return q;
}

/// Legs are tried whole: the certificate is both cheaper and stricter than sampling.
class CertifiedMotion : public ob::MotionValidator {
 public:
  CertifiedMotion(const ob::SpaceInformationPtr& si, const CollisionScene& scene, const std::vector<Watch>& watches)
      : ob::MotionValidator(si), scene_(scene), watches_(watches) {}
  bool checkMotion(const ob::State* a, const ob::State* b) const override {
    return scene_.certify(watches_, {{joints_of(a), joints_of(b)}, false}).is_free;
  }
  bool checkMotion(const ob::State* a, const ob::State* b, std::pair<ob::State*, double>& last) const override {
    const bool ok = checkMotion(a, b);
    if (!ok) {
      last.second = 0;
      if (last.first) si_->copyState(last.first, a);
    }
    return ok;
  }

 private:
  const CollisionScene& scene_;
  const std::vector<Watch>& watches_;
};

double length_of(const JointVector& a, const JointVector& b) {
  double s = 0;
  for (int i = 0; i < 6; ++i) s += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(s);
}

}  // namespace

std::optional<std::vector<JointVector>> find_free_move(const CollisionScene& scene, const std::vector<Watch>& watches, const JointVector& q_start,
                                                       const JointVector& q_goal, int iterations_count) {
  const auto is_free = [&](const JointVector& q) {
    for (const Watch& w : watches)
      if (scene.separation(w.a, w.b, q, w.margin_mm).distance_mm < w.margin_mm) return false;
    return true;
  };
  if (!is_free(q_start) || !is_free(q_goal)) return std::nullopt;

  ompl::msg::noOutputHandler();
  auto space = std::make_shared<Space>(6);
  ob::RealVectorBounds bounds(6);
  for (unsigned i = 0; i < 6; ++i) {
    // Full turns are for reach, not for travel: the box of the two ends and one turn about is enough.
    const JointSpec& j = scene.robot().spec().joints[i];
    const double lo = std::min(q_start[i], q_goal[i]), hi = std::max(q_start[i], q_goal[i]);
    bounds.setLow(i, std::max(j.min_rad, lo - 1.5));
    bounds.setHigh(i, std::min(j.max_rad, hi + 1.5));
  }
  space->setBounds(bounds);
  space->setStateSamplerAllocator([](const ob::StateSpace* s) { return std::make_shared<FixedSampler>(s); });
  auto si = std::make_shared<ob::SpaceInformation>(space);
  si->setStateValidityChecker([&](const ob::State* s) { return is_free(joints_of(s)); });
  si->setMotionValidator(std::make_shared<CertifiedMotion>(si, scene, watches));
  si->setup();
  auto problem = std::make_shared<ob::ProblemDefinition>(si);
  ob::ScopedState<Space> a(space), b(space);
  for (unsigned i = 0; i < 6; ++i) a[i] = q_start[i], b[i] = q_goal[i];
  problem->setStartAndGoalStates(a, b);
  auto planner = std::make_shared<og::RRTConnect>(si);
  planner->setRange(0.6);
  planner->setNearestNeighbors<ompl::NearestNeighborsLinear>();
  planner->setProblemDefinition(problem);
  planner->setup();
  ob::IterationTerminationCondition budget(static_cast<unsigned>(std::max(1, iterations_count)));
  const ob::PlannerStatus status = planner->solve(budget);
  if (status != ob::PlannerStatus::EXACT_SOLUTION) return std::nullopt;
  std::vector<JointVector> q;
  const auto* path = problem->getSolutionPath()->as<og::PathGeometric>();
  for (std::size_t i = 0; i < path->getStateCount(); ++i) q.push_back(joints_of(path->getState(static_cast<unsigned>(i))));

  // Shorten: drop corners, then cut between random places of the path.
  const auto leg_is_free = [&](const JointVector& x, const JointVector& y) { return scene.certify(watches, {{x, y}, false}).is_free; };
  for (std::size_t i = 0; i + 2 < q.size();) {
    std::size_t k = q.size() - 1;
    while (k > i + 1 && !leg_is_free(q[i], q[k])) --k;
    q.erase(q.begin() + static_cast<std::ptrdiff_t>(i) + 1, q.begin() + static_cast<std::ptrdiff_t>(k));
    ++i;
  }
  Random random = Random::stream(42, "shorten");
  for (int round = 0; round < 60 && q.size() > 2; ++round) {
    const std::size_t i = random.below(q.size() - 1), k = random.below(q.size() - 1);
    if (i == k) continue;
    const std::size_t lo = std::min(i, k), hi = std::max(i, k);
    const double s = random.uniform(), t = random.uniform();
    JointVector x, y;
    for (int j = 0; j < 6; ++j) x[j] = q[lo][j] + s * (q[lo + 1][j] - q[lo][j]), y[j] = q[hi][j] + t * (q[hi + 1][j] - q[hi][j]);
    double old_length = length_of(x, q[lo + 1]) + length_of(q[hi], y);
    for (std::size_t n = lo + 1; n < hi; ++n) old_length += length_of(q[n], q[n + 1]);
    if (length_of(x, y) > 0.98 * old_length || !leg_is_free(x, y)) continue;
    std::vector<JointVector> shorter(q.begin(), q.begin() + static_cast<std::ptrdiff_t>(lo) + 1);
    shorter.push_back(x), shorter.push_back(y);
    shorter.insert(shorter.end(), q.begin() + static_cast<std::ptrdiff_t>(hi) + 1, q.end());
    q = std::move(shorter);
  }
  return q;
}

}  // namespace asbuilt
