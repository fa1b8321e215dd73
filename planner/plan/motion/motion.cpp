// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/motion.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "planner/base/number.hpp"
#include "planner/plan/motion/pass_motion.hpp"
#include "planner/plan/motion/pass_search.hpp"
#include "planner/plan/motion/scanned_part.hpp"
#include "planner/plan/motion/transfer.hpp"
#include "planner/plan/path/gate.hpp"

namespace asbuilt {

namespace {

using ToolPose = Pose<frame::Base, frame::Tool>;

constexpr double kStation_mm = 5;                     // long blocks are looked at this often
constexpr double kBlockTurn_rad = rad_from_deg(4.5);  // orientation change of one emitted block stays below 5 degrees
constexpr double kFluteFixture_mm = 1.0;              // of the cutter from fixture and obstacles, beside the robot's own error
constexpr double kDepartureWorthTelling_mm = 0.01;

std::vector<PassStation> stations_of(const CutPass& pass, const Pose<frame::Base, frame::Part>& T_base_part) {
  std::vector<PassStation> out;
  for (const PathPoint& p : pass.points) {
    PassStation s{T_base_part.point(p.tip_part), T_base_part.direction(p.axis_part).normalized(), p.feed_mm_s, p.s_mm};
    if (!out.empty()) {
      const PassStation before = out.back();
      const Vec3 normal = before.axis.cross(s.axis);
      const double turn = std::atan2(normal.norm(), before.axis.dot(s.axis));
      const bool is_turning = turn > kBlockTurn_rad;
      const int parts = static_cast<int>(std::max({1.0, std::ceil(turn / kBlockTurn_rad), std::ceil((s.tip - before.tip).norm() / kStation_mm)}));
      const Vec3 about = normal.norm() > 1e-12 ? Vec3(normal.normalized()) : Vec3::UnitX();
      for (int k = 1; k < parts; ++k) {
        const double t = static_cast<double>(k) / parts;
        out.push_back({before.tip + t * (s.tip - before.tip), Eigen::AngleAxisd(t * turn, about) * before.axis, s.feed_mm_s,
                       before.s_mm + t * (s.s_mm - before.s_mm), is_turning});
      }
    }
    out.push_back(s);
  }
  return out;
}

std::string where_of(const CutPass& pass, const Features& features) {
  std::string text = "feature " + pass.feature + ", pass " + std::to_string(pass.pass) + " of " + std::to_string(pass.passes);
  for (std::size_t i = 0; i < pass.edges.size() && i < 4; ++i) {
    const auto k = static_cast<std::size_t>(pass.edges[i]);
    if (k < features.edges.size()) text += (i == 0 ? ", edge " : "+") + features.edges[k].id;
  }
  return text;
}

/// The burr over all edges that are worked: how far the part may stand out beyond its faces.
double highest_burr_mm(const Burrs& burrs) {
  double h = 0;
  for (const EdgeBurr& e : burrs.edges)
    for (const double u : e.height_upper_mm)
      if (std::isfinite(u)) h = std::max(h, u);
  return h;
}

double deepest_chamfer_mm(const Job& job) {
  double d = 0;
  for (const Recipe& r : job.recipes) d = std::max(d, r.width_mm + r.tolerance_mm);
  return d;
}

const ToolPose* reference_of(const std::string& feature, const Location& location, const Features& features) {
  for (const auto* m : {&features.T_base_tool_reference, &location.T_base_tool_reference})
    for (const std::string& key : {feature, std::string()})
      if (const auto at = m->find(key); at != m->end()) return &at->second;
  return nullptr;
}

std::vector<JointVector> emitted(const std::vector<PassStation>& stations, const std::vector<JointVector>& q) {
  std::vector<JointVector> out;
  for (std::size_t i = 0; i < q.size(); ++i)
    if (stations[i].is_emitted) out.push_back(q[i]);
  return out;
}

/// A block goes at the slowest feed of what it is made of.
std::vector<double> emitted_feeds(const std::vector<PassStation>& stations, const std::vector<double>& feed_mm_s) {
  std::vector<double> out;
  double least = 1e9;
  for (std::size_t i = 0; i < feed_mm_s.size(); ++i) {
    least = std::min(least, feed_mm_s[i]);
    if (!stations[i].is_emitted) continue;
    out.push_back(least);
    least = 1e9;
  }
  return out;
}

/// The posture at a reference pose: in the branch of the feature's capture that it was taken from, else the one nearest to home.
std::optional<JointVector> reference_posture(const Robot& robot, const Job& job, const std::string& feature,
                                             const Pose<frame::Base, frame::Flange>& T_base_flange) {
  JointVector near = robot.spec().home_rad;
  double least = rad_from_deg(20);
  for (const Capture& c : job.captures) {
    const double turn = c.T_base_flange.q.angularDistance(T_base_flange.q);
    if (!c.feature || *c.feature != feature || turn >= least) continue;
    const auto q = c.q_rad ? std::optional<JointVector>(*c.q_rad) : robot.inverse_like(c.T_base_flange, robot.spec().home_rad);
    if (q) near = *q, least = turn;
  }
  return robot.inverse_like(T_base_flange, near);
}

/// Share of the pass in tolerance that is left where the arm's error is `departure_mm` (1 sd) beside what the gate knew of: a point's
/// probability p is that of a normal error within the tolerance of a leg, whose variance grows by the square of the departure.
double share_after_departure(const CutPass& pass, double tolerance_mm, double departure_mm) {
  double sum = 0, length = 0;
  for (std::size_t i = 0; i < pass.points.size(); ++i) {
    const PathPoint& p = pass.points[i];
    if (p.kind != PathPointKind::cut) continue;
    const double way = std::max(1e-3, i > 0 ? (p.tip_part - pass.points[i - 1].tip_part).norm() : 0.0);
    double lo = 1e-4 * tolerance_mm, hi = 1e4 * tolerance_mm;  // sd by halving
    const auto share = [&](double sd) { return std::erf(tolerance_mm / (std::sqrt(2.0) * sd)); };
    for (int k = 0; k < 60; ++k) {
      const double sd = std::sqrt(lo * hi);
      (share(sd) > p.probability_ratio ? lo : hi) = sd;
    }
    sum += way * share(std::hypot(lo, departure_mm)), length += way;
  }
  return length > 0 ? sum / length : 1.0;
}

class Assembly {
 public:
  Assembly(const Robot& robot, const Pose<frame::Flange, frame::Tool>& T_flange_tool) : robot_(robot), T_flange_tool_(T_flange_tool) {}

  void joint_moves(const Transfer& t, double speed_ratio) {
    MotionSegment& s = start(SegmentKind::transfer, -1, t.q_rad, t.clearance_mm);
    s.speed_ratio = speed_ratio;
    s.speed_mm_s.assign(s.q_rad.size(), 0.0);
    for (std::size_t i = 1; i < s.q_rad.size(); ++i) motion.duration_s += joint_time_s(s.q_rad[i - 1], s.q_rad[i], speed_ratio);
  }
  void straight(SegmentKind kind, int pass, const std::vector<JointVector>& q, std::vector<double> speed_mm_s, double clearance_mm) {
    MotionSegment& s = start(kind, pass, q, clearance_mm);
    s.speed_mm_s = std::move(speed_mm_s);
    for (std::size_t i = 1; i < q.size(); ++i)
      motion.duration_s += (s.T_base_tool[i].p_mm - s.T_base_tool[i - 1].p_mm).norm() / std::max(s.speed_mm_s[i], 0.1);
  }

  Motion motion;

 private:
  MotionSegment& start(SegmentKind kind, int pass, const std::vector<JointVector>& q, double clearance_mm) {
    MotionSegment s;
    s.kind = kind, s.pass = pass, s.q_rad = q, s.clearance_mm = clearance_mm;
    for (const JointVector& v : q) {
      s.T_base_tool.push_back(robot_.forward(v) * T_flange_tool_);
      motion.joint_margin_min_rad = std::min(motion.joint_margin_min_rad, robot_.joint_margin_rad(v));
    }
    motion.clearance_min_mm = std::min(motion.clearance_min_mm, clearance_mm);
    motion.segments.push_back(std::move(s));
    return motion.segments.back();
  }
  double joint_time_s(const JointVector& a, const JointVector& b, double ratio) const {
    double t = 0;
    for (int i = 0; i < 6; ++i) {
      const JointSpec& j = robot_.spec().joints[i];
      const double v = ratio * j.speed_rad_s;
      if (v > 0) t = std::max(t, std::abs(b[i] - a[i]) / v + (j.acceleration_rad_s2 > 0 ? v / (ratio * j.acceleration_rad_s2) : 0.0));
    }
    return t;
  }
  const Robot& robot_;
  Pose<frame::Flange, frame::Tool> T_flange_tool_;
};

struct ToolCell {  // what is built once for each tool
  CellScene cell;
  std::optional<RobotErrorModel> errors;
};

}  // namespace

Result<Done<Motion>> plan_motion(const MotionRecipe& recipe, const Job& job, const Location& location, const Features& features,
                                 const Burrs& burrs, const ToolPath& path) {
  const auto made = Robot::from(job.cell.robot);
  if (!made) return refuse_all(made.error());
  const Robot& robot = *made;
  RobotSpec free_spec = job.cell.robot;
  for (JointSpec& j : free_spec.joints) j.min_rad = -kPi, j.max_rad = kPi;
  const Robot free_robot = *Robot::from(free_spec);
  const JointVector home = job.cell.robot.home_rad;
  Done<Motion> done;

  const Mesh part = scanned_part(job.part.brep.mesh, features);  // collisions are looked for on the part as it was measured
  const double burr_mm = highest_burr_mm(burrs);
  std::map<std::string, ToolCell> cells;
  std::map<std::string, double> departures;
  std::optional<Assembly> assembly;
  JointVector q = home;
  std::string tool_before;

  if (path.passes.empty())
    return refuse({.code = "motion.nothing_to_do", .where = job.item_id, .message = "the tool path has no pass; give the part features with edges", .stage = "motion"});

  for (std::size_t k = 0; k < path.passes.size(); ++k) {
    const CutPass& pass = path.passes[k];
    const Recipe* process = job.recipe(pass.recipe);
    const ToolSpec* tool = job.tool(pass.tool);
    must(process && tool, "a pass whose recipe or tool is not in the job");
    must(pass.points.size() >= 2, "a pass with fewer than two points");
    if (!cells.count(pass.tool)) {
      ToolCell c{cell_scene(robot, job, part, location, *tool, recipe.clearance_mm, kFluteFixture_mm + job.cell.robot.accuracy.absolute.mean_mm,
                            deepest_chamfer_mm(job)),
                 {}};
      if (reference_of(pass.feature, location, features)) c.errors.emplace(robot, tool->T_flange_tool);
      done.notes.insert(done.notes.end(), c.cell.notes.begin(), c.cell.notes.end());
      const std::vector<Watch> at_home = c.cell.with_flute(recipe.clearance_mm);
      const Certificate home_is = c.cell.scene.certify(at_home, {{home}, false});
      if (!home_is.is_free)
        return refuse({.code = "motion.collision", .where = "robot.home",
                       .message = pair_name(c.cell, at_home[static_cast<std::size_t>(home_is.watch)]) + " are " + text_mm(home_is.clearance_mm) +
                                  " mm apart with the robot at home (" + text_mm(recipe.clearance_mm) + " mm are wanted); choose another home or correct the cell",
                       .measured = home_is.clearance_mm, .limit = recipe.clearance_mm, .unit = "mm", .stage = "motion"});
      if (robot.joint_margin_rad(home) < 0)
        return refuse({.code = "motion.joint_limit", .where = "robot.home", .message = "home lies outside the joint limits; correct the cell file",
                       .measured = deg_from_rad(robot.joint_margin_rad(home)), .limit = 0, .unit = "deg", .stage = "motion"});
      cells.emplace(pass.tool, std::move(c));
    }
    const ToolCell& cell = cells.at(pass.tool);
    const PassTools tools{&robot, &free_robot, &cell.cell, cell.errors ? &*cell.errors : nullptr, tool->T_flange_tool, recipe.joint_margin_rad};
    if (!assembly) assembly.emplace(robot, tool->T_flange_tool);
    if (!tool_before.empty() && tool_before != pass.tool)
      return refuse({.code = "motion.tool_change", .where = where_of(pass, features),
                     .message = "the job needs two tools (" + tool_before + ", " + pass.tool + ") and no tool change is planned; make one item of each",
                     .measured = 2, .limit = 1, .unit = "tools", .stage = "motion"});
    tool_before = pass.tool;

    PassTask task;
    task.where = where_of(pass, features);
    task.stations = stations_of(pass, location.T_base_part);
    task.retract_base = location.T_base_part.direction(pass.retract_part).normalized();
    task.approach_mm = std::max(pass.approach_mm > 0 ? pass.approach_mm : process->approach_mm, 1.0);
    task.approach_speed_mm_s = recipe.approach_speed_mm_s;
    task.feed_min_mm_s = process->feed_min_mm_s;
    task.flute_approach_mm = std::min(1.0 + burr_mm, 0.5 * task.approach_mm);
    task.flute_near_mm = std::min(5.0 + 1.5 * burr_mm, task.approach_mm);
    if (const ToolPose* T = reference_of(pass.feature, location, features)) {
      task.x_hint = T->direction(Vec3::UnitX());
      task.q_reference = reference_posture(robot, job, pass.feature, *T * tool->T_flange_tool.inverse());
    } else {
      task.x_hint = (robot.forward(home) * tool->T_flange_tool).direction(Vec3::UnitX());
    }

    const std::vector<Watch> in_transfer = cell.cell.with_flute(std::min(recipe.clearance_mm + burr_mm, 0.8 * task.approach_mm));
    Transfer transfer;
    const auto accept = [&](const PassMotion& m, bool is_thorough) -> std::optional<Refusal> {
      auto t = plan_transfer(q, m.approach.front(), tools, in_transfer, is_thorough ? recipe.planner_iterations_count : 0,
                             (k == 0 ? "from home to " : "on the way to ") + task.where);
      if (!t) return t.error().front();
      transfer = std::move(*t);
      return std::nullopt;
    };
    auto planned = plan_pass(task, tools, q, accept);
    if (!planned) return refuse_all(planned.error());
    const PassMotion& m = *planned;
    if (m.departure_mm > kDepartureWorthTelling_mm) {
      const double share = share_after_departure(pass, process->tolerance_mm, m.departure_mm);
      const bool is_overridden = std::all_of(pass.edges.begin(), pass.edges.end(), [&](int e) {
        return override_for(job, features.edges[static_cast<std::size_t>(e)].id) != nullptr;
      });
      if (share < process->gate_probability_ratio && !is_overridden)
        return refuse({.code = "motion.left_reference", .where = task.where,
                       .message = "the tool can only be brought here in another posture than the one the points were corrected for: the arm's error differs by " +
                                  fixed_number(m.departure_mm, 3) + " mm (1 sd) there, and only " + fixed_number(100 * share, 1) +
                                  " % of the pass are expected in tolerance (" + fixed_number(100 * process->gate_probability_ratio, 1) +
                                  " % wanted); free the way for the scan's posture, or scan in the posture that is free",
                       .measured = share, .limit = process->gate_probability_ratio, .unit = "ratio", .stage = "motion"});
    }

    const int index = static_cast<int>(k);
    assembly->joint_moves(transfer, recipe.transfer_speed_ratio);
    const std::vector<double> straight_speed(2, m.approach_speed_mm_s);
    assembly->straight(SegmentKind::approach, index, {m.approach.front(), m.approach.back()}, straight_speed, m.approach_clearance_mm);
    assembly->straight(SegmentKind::cut, index, emitted(m.stations, m.cut), emitted_feeds(m.stations, m.feed_mm_s), m.cut_clearance_mm);
    assembly->straight(SegmentKind::retract, index, {m.retract.front(), m.retract.back()}, straight_speed, m.retract_clearance_mm);
    assembly->motion.singularity_min_ratio = std::min(assembly->motion.singularity_min_ratio, m.singularity_ratio);
    departures[pass.feature] = std::max(departures[pass.feature], m.departure_mm);
    q = m.retract.back();
    if (k + 1 == path.passes.size()) {
      auto back = plan_transfer(q, home, tools, in_transfer, recipe.planner_iterations_count, "from " + task.where + " to home");
      if (!back) return refuse_all(back.error());
      assembly->joint_moves(*back, recipe.transfer_speed_ratio);
    }
  }
  for (const auto& [feature, mm] : departures)
    if (mm > kDepartureWorthTelling_mm)
      done.notes.push_back({Note::Level::warning, "motion.left_reference",
                            "the tool had to be turned away from the posture that the points were corrected for: the arm's error there differs by " +
                                fixed_number(mm, 3) + " mm (1 sd)",
                            "feature " + feature});
  done.artefact = std::move(assembly->motion);
  return done;
}

}  // namespace asbuilt
