// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/inspect/views.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace asbuilt::inspecting {

namespace {

using BaseFlange = Pose<frame::Base, frame::Flange>;

constexpr double kEnough_ratio = 0.98;      // of a stretch: the wanted direction needs no alternative
constexpr std::size_t kKept = 4;            // views of a direction that go into the choice
constexpr int kPostures = 3;                // branches of the arm that are looked at for one pose

double weight_of_joint(std::size_t i) {
  constexpr double w[6] = {1.5, 1.5, 1.2, 0.6, 0.8, 0.4};
  return w[i];
}

double way_between(const JointVector& a, const JointVector& b) {  // how far two postures are apart, for choosing between equals
  double sum = 0;
  for (std::size_t i = 0; i < 6; ++i) sum += weight_of_joint(i) * std::abs(a[i] - b[i]);
  return sum;
}

/// Equal where only the last digits differ.
double in_millionths(double v) { return std::round(v * 1e6); }

struct Reach {
  std::vector<JointVector> q;
  std::string outcome;
  double measured = 0, limit = 0;
  std::string unit;
};

Reach reach_of(const Workshop& shop, const BaseFlange& T) {
  Reach r;
  double best_margin = -1e9, best_singular = -1e9;
  const auto all = shop.robot->inverse(T);
  for (const JointVector& q : all) {
    const double margin = shop.robot->joint_margin_rad(q), singular = shop.robot->singularity_ratio(q);
    best_margin = std::max(best_margin, margin);
    if (margin < shop.recipe->joint_margin_rad) continue;
    best_singular = std::max(best_singular, singular);
    if (singular >= shop.recipe->singularity_min_ratio) r.q.push_back(q);
  }
  const JointVector home = shop.robot->spec().home_rad;
  std::stable_sort(r.q.begin(), r.q.end(), [&](const JointVector& a, const JointVector& b) { return way_between(a, home) < way_between(b, home); });
  if (r.q.size() > kPostures) r.q.resize(kPostures);
  if (!r.q.empty()) return r;
  if (best_singular > -1e8) {
    r.outcome = "singular", r.measured = best_singular, r.limit = shop.recipe->singularity_min_ratio, r.unit = "ratio";
  } else if (!all.empty() || !shop.free_robot->inverse(T).empty()) {
    r.outcome = "joint limit", r.measured = best_margin > -1e8 ? deg_from_rad(best_margin) : 0.0, r.limit = deg_from_rad(shop.recipe->joint_margin_rad), r.unit = "deg";
  } else {
    r.outcome = "unreachable", r.measured = (T.p_mm - shop.robot->axes(home)[1].second).norm(), r.limit = shop.robot->reach_mm(), r.unit = "mm";
  }
  return r;
}

Stand stand_of(const Workshop& shop, int sensor, const BaseFlange& T) {
  Stand s;
  s.sensor = sensor, s.T_base_flange = T;
  s.T_base_sensor = T * shop.cell_spec->sensors[static_cast<std::size_t>(sensor)].T_flange_sensor;
  return s;
}

/// Share of the stretch's stations and faces that are seen.
double share_of(const Workshop& shop, const std::vector<float>& points, std::size_t begin, std::size_t end) {
  std::size_t n = 0;
  for (std::size_t i = 2 * begin; i < 2 * end; ++i) n += is_enough(*shop.recipe, points[i]);
  return static_cast<double>(n) / static_cast<double>(2 * (end - begin));
}

/// Why most of what is not seen is not seen.
std::string main_reason(const Workshop& shop, const Stand& stand, const Stretch& stretch) {
  std::map<Unseen, int> count;
  const auto& stations = shop.edges[static_cast<std::size_t>(stretch.edge)].stations;
  double density = 0;
  bool has_none = false;
  for (std::size_t k = stretch.begin; k < stretch.end; ++k)
    for (const auto& patches : stations[k].patches) {
      has_none |= patches.empty();
      for (const Patch& p : patches) ++count[look(shop.eyes[static_cast<std::size_t>(stand.sensor)], shop.blockers, stand, p, shop.margin_mm, density)];
    }
  count.erase(Unseen::seen);
  if (count.empty()) return has_none ? "face too narrow" : "too few points";
  return std::string(name_of(std::max_element(count.begin(), count.end(), [](const auto& a, const auto& b) { return a.second < b.second; })->first));
}

struct Tally {  // outcomes of one direction over its turns
  std::map<std::string, TriedView> by_outcome;
  void add(const TriedView& head, const std::string& outcome, double measured, double limit, const std::string& unit, bool is_larger_better) {
    const auto [it, is_new] = by_outcome.emplace(outcome, head);
    TriedView& t = it->second;
    t.outcome = outcome, ++t.turns_count, t.unit = unit, t.limit = limit;
    t.measured = is_new ? measured : is_larger_better ? std::max(t.measured, measured) : std::min(t.measured, measured);
  }
};

}  // namespace

bool is_enough(const InspectRecipe& recipe, float points) {
  return static_cast<double>(points) >= recipe.points_min_count * recipe.points_reserve_ratio;
}

std::vector<float> expected_points(const Workshop& shop, const Stand& stand_in, std::size_t begin, std::size_t end) {
  std::vector<float> out(2 * shop.stations_count, 0.0f);
  const SensorEye& eye = shop.eyes[static_cast<std::size_t>(stand_in.sensor)];
  const auto T_sensor_base = stand_in.T_base_sensor.inverse();
  for (std::size_t e = 0; e < shop.edges.size(); ++e) {
    const auto& stations = shop.edges[e].stations;
    for (std::size_t k = 0; k < stations.size(); ++k) {
      const std::size_t g = shop.first_station[e] + k;
      if (g < begin || g >= end) continue;
      const Vec3 p = T_sensor_base.point(stations[k].p);
      constexpr double kNear_mm = 5;  // of the field: the faces reach a little further than the edge
      if (p.z() < eye.range_mm[0] - kNear_mm || p.z() > eye.range_mm[1] + kNear_mm) continue;
      if (std::abs(p.x()) > eye.half_width_ratio[0] * p.z() + kNear_mm || std::abs(p.y()) > eye.half_width_ratio[1] * p.z() + kNear_mm) continue;
      for (std::size_t f = 0; f < 2; ++f) {
        double sum = 0, density = 0;
        for (const Patch& patch : stations[k].patches[f])
          if (look(eye, shop.blockers, stand_in, patch, shop.margin_mm, density) == Unseen::seen) sum += density * patch.area_mm2;
        out[2 * g + f] = static_cast<float>(sum);
      }
    }
  }
  return out;
}

BaseFlange aimed_working(const SensorSpec& sensor, const Vec3& axis, double turn, const Pose<frame::Flange, frame::Tool>& T_flange_tool,
                         const Vec3& target, double distance) {
  const Eigen::Quaterniond q_tool = quat_from_z(axis, Vec3(std::cos(turn), std::sin(turn), 0));
  const Eigen::Quaterniond q = (q_tool * T_flange_tool.q.conjugate()).normalized();
  return {q, target - q * sensor.T_flange_sensor.point(Vec3(0, 0, distance))};
}

BaseFlange aimed_normal(const SensorSpec& sensor, const Vec3& look, double turn, const Vec3& target, double distance) {
  const Eigen::Quaterniond straight = quat_from_z(look, Vec3::UnitX());
  const Eigen::Quaterniond q_sensor = (straight * Eigen::Quaterniond(Eigen::AngleAxisd(turn, Vec3::UnitZ()))).normalized();
  return Pose<frame::Base, frame::Sensor>(q_sensor, target - distance * look) * sensor.T_flange_sensor.inverse();
}

std::vector<Vec3> cone_directions(const Vec3& axis, double half_angle, int count) {
  const Mat3 R = quat_from_z(axis, Vec3::UnitX()).toRotationMatrix();
  std::vector<Vec3> out{axis.normalized()};
  const double golden = kPi * (3 - std::sqrt(5.0));
  for (int k = 1; k < count; ++k) {
    const double tilt = half_angle * std::sqrt(static_cast<double>(k) / (count - 1)), around = golden * k;
    out.push_back((R * Vec3(std::sin(tilt) * std::cos(around), std::sin(tilt) * std::sin(around), std::cos(tilt))).normalized());
  }
  return out;
}

std::vector<ViewCandidate> views_for(const Workshop& shop, const Stretch& stretch, int stretch_index, ViewKind kind, std::vector<TriedView>& tried) {
  const InspectRecipe& recipe = *shop.recipe;
  const EdgeStations& edge = shop.edges[static_cast<std::size_t>(stretch.edge)];
  const std::size_t begin = shop.first_station[static_cast<std::size_t>(stretch.edge)] + stretch.begin, end = begin + (stretch.end - stretch.begin);
  const Vec3 wanted = kind == ViewKind::working ? (edge.recipe != nullptr ? edge.recipe->axis_base : Vec3(-Vec3::UnitZ())).normalized() : Vec3(-stretch.mean_normal);
  const std::vector<Vec3> directions = cone_directions(wanted, recipe.cone_rad, recipe.cone_count);
  const JointVector home = shop.robot->spec().home_rad;
  std::vector<ViewCandidate> best;   // of all directions so far, by share
  for (const int s : shop.sensors) {
    const SensorSpec& sensor = shop.cell_spec->sensors[static_cast<std::size_t>(s)];
    const SensorEye& eye = shop.eyes[static_cast<std::size_t>(s)];
    const double wd = eye.working_distance_mm;
    const double distances[3] = {wd, wd + 0.5 * (eye.range_mm[1] - wd), wd - 0.5 * (wd - eye.range_mm[0])};
    for (const double distance : distances) {
      for (const Vec3& direction : directions) {
        const double tilt = std::atan2(direction.cross(wanted).norm(), direction.dot(wanted));
        if (distance != wd && tilt > 0.6 * recipe.cone_rad) continue;  // nearer and farther: the inner cone
        TriedView head;
        head.edge = edge.id, head.sensor = sensor.id, head.kind = kind, head.tilt_rad = tilt, head.distance_mm = distance;
        const auto& st = edge.stations;
        head.s_from_mm = st[stretch.begin].s_mm, head.s_to_mm = st[stretch.end - 1].s_mm;
        Tally tally;
        std::vector<ViewCandidate> here;
        for (int t = 0; t < recipe.turns_count; ++t) {
          // the wanted direction gets every turn, an alternative every second
          if (tilt > 1e-9 && t % 2 == 1) continue;
          const double turn = 2 * kPi * t / recipe.turns_count;
          const BaseFlange T = kind == ViewKind::working ? aimed_working(sensor, direction, turn, shop.tool->T_flange_tool, stretch.middle, distance)
                                                         : aimed_normal(sensor, direction, turn, stretch.middle, distance);
          ViewCandidate c;
          c.stretch = stretch_index, c.sensor = s, c.kind = kind, c.tilt_rad = tilt, c.turn_rad = turn, c.distance_mm = distance, c.T_base_flange = T;
          c.points = expected_points(shop, stand_of(shop, s, T), begin, end);
          c.share_ratio = share_of(shop, c.points, begin, end);
          const bool is_poor = c.share_ratio < 0.25 || (!best.empty() && c.share_ratio < 0.5 * best.front().share_ratio);
          if (is_poor) {
            tally.add(head, main_reason(shop, stand_of(shop, s, T), stretch), c.share_ratio, kEnough_ratio, "ratio", true);
            continue;
          }
          const Reach reach = reach_of(shop, T);
          if (reach.q.empty()) {
            tally.add(head, reach.outcome, reach.measured, reach.limit, reach.unit, reach.outcome != "unreachable");
            continue;
          }
          for (const JointVector& q : reach.q) {
            c.q = q;
            here.push_back(c);
          }
        }
        // the ones that see most, near home first among equals; clear of everything
        std::stable_sort(here.begin(), here.end(), [&](const ViewCandidate& a, const ViewCandidate& b) {
          return std::pair(-in_millionths(a.share_ratio), way_between(a.q, home)) < std::pair(-in_millionths(b.share_ratio), way_between(b.q, home));
        });
        std::vector<ViewCandidate> kept;
        for (ViewCandidate& c : here) {
          if (kept.size() >= kKept) break;
          if (std::any_of(kept.begin(), kept.end(), [&](const ViewCandidate& k) { return k.turn_rad == c.turn_rad; })) continue;  // one posture a pose
          const Certificate clear = shop.cell->scene.certify(shop.watches, {{c.q}, false});
          if (!clear.is_free) {
            const Watch& w = shop.watches[static_cast<std::size_t>(clear.watch)];
            tally.add(head, "collision of " + pair_name(*shop.cell, w), clear.clearance_mm, w.margin_mm, "mm", true);
            continue;
          }
          c.clearance_mm = clear.clearance_mm;
          // what the arm itself hides is known with the posture
          Stand stand = stand_of(shop, s, c.T_base_flange);
          const auto links = shop.robot->link_motion(c.q);
          stand.link_motion = &links;
          c.points = expected_points(shop, stand, 0, shop.stations_count);
          c.share_ratio = share_of(shop, c.points, begin, end);
          tally.add(head, c.share_ratio >= kEnough_ratio ? "sees enough" : "sees too little: " + main_reason(shop, stand, stretch), c.share_ratio, kEnough_ratio, "ratio", true);
          kept.push_back(std::move(c));
        }
        for (auto& [outcome, t] : tally.by_outcome) tried.push_back(t);
        best.insert(best.end(), std::make_move_iterator(kept.begin()), std::make_move_iterator(kept.end()));
        std::stable_sort(best.begin(), best.end(), [&](const ViewCandidate& a, const ViewCandidate& b) {
          return std::pair(-in_millionths(a.share_ratio), in_millionths(a.tilt_rad)) < std::pair(-in_millionths(b.share_ratio), in_millionths(b.tilt_rad));
        });
        if (best.size() > 3 * kKept) best.resize(3 * kKept);
        if (!best.empty() && best.front().share_ratio >= kEnough_ratio) return best;
      }
    }
  }
  return best;
}

}  // namespace asbuilt::inspecting
