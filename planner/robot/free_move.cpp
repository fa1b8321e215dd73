// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/robot/free_move.hpp"

#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/goals/GoalState.h>
#include <ompl/base/objectives/PathLengthOptimizationObjective.h>
#include <ompl/base/samplers/InformedStateSampler.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/base/terminationconditions/IterationTerminationCondition.h>
#include <ompl/datastructures/NearestNeighborsLinear.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/planners/informedtrees/BITstar.h>
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

  Random& random() { return random_; }

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
    ++count_;
    return scene_.certify(watches_, {{joints_of(a), joints_of(b)}, false}).is_free;
  }
  int count() const { return count_; }
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
  mutable int count_ = 0;
};

double length_of(const JointVector& a, const JointVector& b) {
  double s = 0;
  for (int i = 0; i < 6; ++i) s += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(s);
}

/// Uniform where the way over the state is shorter than the best one: in the box first, then in the ellipsoid about both ends itself
/// [Gammell2014], which may be thousands of times smaller. Never says no: BIT* asks again until it has its batch, and its budget is not asked
/// meanwhile. OMPL's own draws from a generator that is seeded once for the whole process.
class FixedInformedSampler : public ob::InformedSampler {
 public:
  FixedInformedSampler(const ob::ProblemDefinitionPtr& problem, unsigned calls, const JointVector& a, const JointVector& b)
      : ob::InformedSampler(problem, calls), sampler_(space_.get()), a_(a), b_(b) {}
  bool sampleUniform(ob::State* state, const ob::Cost& most) override {
    const auto is_shorter = [&] { return length_of(a_, joints_of(state)) + length_of(joints_of(state), b_) < most.value(); };
    for (int i = 0; i < kDraws; ++i) {
      sampler_.sampleUniform(state);
      if (is_shorter()) return true;
    }
    const Eigen::Map<const Eigen::Matrix<double, 6, 1>> a(a_.data()), b(b_.data());
    const double between = (b - a).norm(), across = 0.5 * std::sqrt(std::max(0.0, most.value() * most.value() - between * between));
    const Eigen::Matrix<double, 6, 1> axis = between > 0 ? Eigen::Matrix<double, 6, 1>((b - a) / between) : Eigen::Matrix<double, 6, 1>::Unit(0);
    const auto put = [&](const Eigen::Matrix<double, 6, 1>& q) {
      for (unsigned i = 0; i < 6; ++i) (*state->as<Space::StateType>())[i] = q[i];
    };
    for (int i = 0; i < kDraws; ++i) {
      Eigen::Matrix<double, 6, 1> u;
      for (double& x : u) x = sampler_.random().normal();
      u *= std::pow(sampler_.random().uniform(0, 1), 1.0 / 6) / std::max(1e-12, u.norm());  // uniform in the ball
      const double along = axis.dot(u);
      put(0.5 * (a + b) + across * (u - along * axis) + 0.5 * most.value() * along * axis);
      if (space_->satisfiesBounds(state) && is_shorter()) return true;
    }
    put(a + sampler_.random().uniform(0, 1) * (b - a));  // hardly any room: on the straight way
    return true;
  }
  bool sampleUniform(ob::State* state, const ob::Cost& least, const ob::Cost& most) override {
    for (int i = 0; i < kDraws; ++i)
      if (sampleUniform(state, most) && length_of(a_, joints_of(state)) + length_of(joints_of(state), b_) >= least.value()) return true;
    return true;  // inside, if not outside the inner one
  }
  bool hasInformedMeasure() const override { return false; }
  double getInformedMeasure(const ob::Cost&) const override { return space_->getMeasure(); }

 private:
  static constexpr int kDraws = 100;
  FixedSampler sampler_;
  JointVector a_, b_;
};

class FixedLength : public ob::PathLengthOptimizationObjective {
 public:
  FixedLength(const ob::SpaceInformationPtr& si, const JointVector& a, const JointVector& b) : ob::PathLengthOptimizationObjective(si), a_(a), b_(b) {}
  ob::InformedSamplerPtr allocInformedStateSampler(const ob::ProblemDefinitionPtr& problem, unsigned calls) const override {
    return std::make_shared<FixedInformedSampler>(problem, calls, a_, b_);
  }

 private:
  JointVector a_, b_;
};

struct Setting {  // space, validity, motions and ends of one search
  std::shared_ptr<Space> space;
  ob::SpaceInformationPtr si;
  std::shared_ptr<CertifiedMotion> motions;
  ob::ProblemDefinitionPtr problem;
};

std::optional<Setting> setting_of(const CollisionScene& scene, const std::vector<Watch>& watches, const JointVector& q_start, const JointVector& q_goal) {
  const auto is_free = [&scene, &watches](const JointVector& q) {
    for (const Watch& w : watches)
      if (scene.separation(w.a, w.b, q, w.margin_mm).distance_mm < w.margin_mm) return false;
    return true;
  };
  if (!is_free(q_start) || !is_free(q_goal)) return std::nullopt;

  ompl::msg::noOutputHandler();
  Setting out;
  out.space = std::make_shared<Space>(6);
  ob::RealVectorBounds bounds(6);
  for (unsigned i = 0; i < 6; ++i) {
    // Full turns are for reach, not for travel: the box of the two ends and one turn about is enough.
    const JointSpec& j = scene.robot().spec().joints[i];
    const double lo = std::min(q_start[i], q_goal[i]), hi = std::max(q_start[i], q_goal[i]);
    bounds.setLow(i, std::max(j.min_rad, lo - 1.5));
    bounds.setHigh(i, std::min(j.max_rad, hi + 1.5));
  }
  out.space->setBounds(bounds);
  out.space->setStateSamplerAllocator([](const ob::StateSpace* s) { return std::make_shared<FixedSampler>(s); });
  out.si = std::make_shared<ob::SpaceInformation>(out.space);
  out.si->setStateValidityChecker([is_free](const ob::State* s) { return is_free(joints_of(s)); });
  out.motions = std::make_shared<CertifiedMotion>(out.si, scene, watches);
  out.si->setMotionValidator(out.motions);
  out.si->setup();
  out.problem = std::make_shared<ob::ProblemDefinition>(out.si);
  ob::ScopedState<Space> a(out.space), b(out.space);
  for (unsigned i = 0; i < 6; ++i) a[i] = q_start[i], b[i] = q_goal[i];
  out.problem->setStartAndGoalStates(a, b);
  return out;
}

/// Drops corners, then cuts between random places of the path.
std::vector<JointVector> shortened(const CollisionScene& scene, const std::vector<Watch>& watches, std::vector<JointVector> q) {
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

std::vector<JointVector> path_of(const ob::ProblemDefinitionPtr& problem) {
  std::vector<JointVector> q;
  const auto* path = problem->getSolutionPath()->as<og::PathGeometric>();
  for (std::size_t i = 0; i < path->getStateCount(); ++i) q.push_back(joints_of(path->getState(static_cast<unsigned>(i))));
  return q;
}

constexpr unsigned kIdleBatchesMax = 30;

}  // namespace

std::optional<std::vector<JointVector>> find_free_move(const CollisionScene& scene, const std::vector<Watch>& watches, const JointVector& q_start,
                                                       const JointVector& q_goal, int iterations_count) {
  const auto s = setting_of(scene, watches, q_start, q_goal);
  if (!s) return std::nullopt;
  auto planner = std::make_shared<og::RRTConnect>(s->si);
  planner->setRange(0.6);
  planner->setNearestNeighbors<ompl::NearestNeighborsLinear>();
  planner->setProblemDefinition(s->problem);
  planner->setup();
  ob::IterationTerminationCondition budget(static_cast<unsigned>(std::max(1, iterations_count)));
  const ob::PlannerStatus status = planner->solve(budget);
  if (status != ob::PlannerStatus::EXACT_SOLUTION) return std::nullopt;
  return shortened(scene, watches, path_of(s->problem));
}

std::optional<std::vector<JointVector>> find_short_move(const CollisionScene& scene, const std::vector<Watch>& watches, const JointVector& q_start,
                                                        const JointVector& q_goal, int certificates_count) {
  const auto s = setting_of(scene, watches, q_start, q_goal);
  if (!s) return std::nullopt;
  s->problem->setOptimizationObjective(std::make_shared<FixedLength>(s->si, q_start, q_goal));
  // its own tree of neighbours draws pivots from OMPL's generator, but answers exactly whatever they are
  auto planner = std::make_shared<og::BITstar>(s->si);
  planner->setSamplesPerBatch(60);
  planner->setProblemDefinition(s->problem);
  planner->setup();
  int asked = 0;
  const CertifiedMotion& motions = *s->motions;
  // batch after batch without a single motion to be looked at: no sample can be joined to either end (one of them is walled in)
  unsigned batch_of_progress = 0;
  int certificates_before = 0;
  const ob::PlannerTerminationCondition budget([&, search = planner.get()] {
    const int now = static_cast<int>(motions.count());
    if (now != certificates_before) certificates_before = now, batch_of_progress = search->numBatches();
    return now >= certificates_count || ++asked > 20 * certificates_count || search->numBatches() > batch_of_progress + kIdleBatchesMax;
  });
  const ob::PlannerStatus status = planner->solve(budget);
  if (status != ob::PlannerStatus::EXACT_SOLUTION) return std::nullopt;
  return shortened(scene, watches, path_of(s->problem));
}

}  // namespace asbuilt
