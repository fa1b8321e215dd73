// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/inspect/inspect.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/plan/inspect/cover.hpp"
#include "planner/plan/inspect/forecast.hpp"
#include "planner/plan/inspect/views.hpp"
#include "planner/plan/motion/transfer.hpp"
#include "planner/robot/free_move.hpp"

namespace asbuilt {

using namespace inspecting;

namespace {

constexpr const char* kStage = "inspect";
constexpr int kRoundsMax = 3;
constexpr double kFluteFixture_mm = 1.5;

std::string text_mm(double v) { return fixed_number(v, 2); }
std::string text_percent(double ratio) { return fixed_number(100 * ratio, 1); }

/// How far a point of the worked edges may lie from where it is taken to be (3 sd).
double place_margin_mm(const Location& location, const std::vector<EdgeStations>& edges) {
  double worst = 0;
  for (const EdgeStations& e : edges)
    for (const Station& s : e.stations) {
      Eigen::Matrix<double, 3, 6> j;
      const Mat3 R = location.T_base_part.rotation();
      j.leftCols<3>() = R, j.rightCols<3>() = -R * skew(location.T_base_part.inverse().point(s.p));
      const Mat3 c = j * location.covariance * j.transpose();
      worst = std::max(worst, std::sqrt(std::max(0.0, c.trace())));
    }
  return 3 * worst;
}

Blockers blockers_of(const Job& job, const Location& location, const ToolSpec& tool) {
  Blockers b;
  Mesh standing = transformed(location.T_base_part, job.part.brep.mesh);
  const auto append = [](Mesh& to, const Mesh& more) {
    const int n = static_cast<int>(to.vertices.size());
    to.vertices.insert(to.vertices.end(), more.vertices.begin(), more.vertices.end());
    for (const auto& t : more.triangles) to.triangles.push_back({t[0] + n, t[1] + n, t[2] + n});
  };
  append(standing, transformed(job.fixture.T_base_fixture, job.fixture.mesh_fixture));
  for (const Obstacle& o : job.cell.obstacles) append(standing, o.mesh_base);
  b.standing_base = RayTree(standing);
  const CutterProfile profile = profile_of(tool.cutter);
  for (std::size_t own = 0; own < job.cell.sensors.size(); ++own) {
    Mesh riding = tool.mesh_flange;
    append(riding, transformed(tool.T_flange_tool, cutter_mesh(profile, 0, profile.length_mm)));
    for (std::size_t k = 0; k < job.cell.sensors.size(); ++k)
      if (k != own) append(riding, job.cell.sensors[k].mesh_flange);
    b.riding_flange.emplace_back(riding);
  }
  for (const LinkMesh& l : job.cell.robot.links)
    if (l.joint >= 1 && !l.mesh.triangles.empty()) b.links.emplace_back(l.joint, RayTree(l.mesh));
  return b;
}

double joint_time_s(const RobotSpec& robot, const JointVector& a, const JointVector& b, double ratio) {
  double t = 0;
  for (std::size_t i = 0; i < 6; ++i) {
    const JointSpec& j = robot.joints[i];
    const double v = ratio * j.speed_rad_s, way = std::abs(b[i] - a[i]);
    t = std::max(t, v > 0 ? way / v + (j.acceleration_rad_s2 > 0 && way > 0 ? v / (ratio * j.acceleration_rad_s2) : 0.0) : way);
  }
  return t;
}
double way_time_s(const RobotSpec& robot, const std::vector<JointVector>& q, double ratio) {
  double t = 0;
  for (std::size_t i = 1; i < q.size(); ++i) t += joint_time_s(robot, q[i - 1], q[i], ratio);
  return t;
}

/// Straight where that is free; else the quicker of a way over raised postures and BIT*'s; else a search.
Result<Transfer> short_transfer(const Workshop& shop, const PassTools& tools, const JointVector& a, const JointVector& b, const std::string& where) {
  const CollisionScene& scene = shop.cell->scene;
  const Certificate straight = scene.certify(shop.watches, {{a, b}, false});
  if (straight.is_free) return Transfer{{a, b}, straight.clearance_mm};
  const double ratio = shop.recipe->transfer_speed_ratio;
  auto raised = plan_transfer(a, b, tools, shop.watches, 0, where);
  const auto found = find_short_move(scene, shop.watches, a, b, shop.recipe->short_move_count);
  if (found) {
    const Certificate c = scene.certify(shop.watches, {*found, false});
    if (c.is_free && (!raised || way_time_s(shop.cell_spec->robot, *found, ratio) < way_time_s(shop.cell_spec->robot, raised->q_rad, ratio)))
      return Transfer{*found, c.clearance_mm};
  }
  if (raised) return raised;
  return plan_transfer(a, b, tools, shop.watches, shop.recipe->planner_iterations_count, where);
}

/// What stands for a station and face seen by a view of one kind.
Bits bits_of(const Workshop& shop, const ViewCandidate& c) {
  Bits b(4 * shop.stations_count);
  for (std::size_t i = 0; i < 2 * shop.stations_count; ++i)
    if (is_enough(*shop.recipe, c.points[i])) b.set(2 * i + (c.kind == ViewKind::working ? 0 : 1));
  return b;
}

double price_of(const ViewCandidate& c, const JointVector& home) {
  double way = 0;
  for (std::size_t i = 0; i < 6; ++i) way += std::abs(c.q[i] - home[i]);
  return std::round(1e6 * (c.tilt_rad + 0.1 * way));
}

/// The refusal of an edge that no set of views covers, with what stood in the way most often.
Refusal not_covered(const Workshop& shop, const EdgeForecast& f, const std::vector<TriedView>& tried) {
  double from = 0, to = 0;
  bool has_gap = false;
  for (std::size_t k = 0; k < f.s_mm.size(); ++k)
    if (!std::isfinite(f.sd_mm[k])) {
      if (!has_gap) from = f.s_mm[k];
      to = f.s_mm[k], has_gap = true;
    }
  std::map<std::string, int> count;
  for (const TriedView& t : tried)
    if (t.edge == f.id && t.outcome != "sees enough") count[t.outcome.rfind("sees too little: ", 0) == 0 ? t.outcome.substr(17) : t.outcome] += t.turns_count;
  std::vector<std::pair<std::string, int>> reasons(count.begin(), count.end());
  std::stable_sort(reasons.begin(), reasons.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  std::string all = "nothing was tried", help = "give the edge another feature or leave it out";
  for (std::size_t i = 0; i < reasons.size() && i < 4; ++i) all = (i == 0 ? "" : all + ", ") + std::to_string(reasons[i].second) + " " + reasons[i].first;
  if (!reasons.empty()) {
    const std::string& why = reasons.front().first;
    if (why.rfind("hidden", 0) == 0) help = "turn or lift the part so that both faces of the edge lie open, or take away what hides them";
    else if (why == "too steep") help = "mount the part so that both faces of the edge can be looked at, or allow the sensor a steeper incidence";
    else if (why.rfind("collision", 0) == 0) help = "move what is in the way, or mount the sensor farther from the tool";
    else if (why == "unreachable" || why == "joint limit" || why == "singular") help = "set the part nearer to the middle of the robot's reach, or turn the fixture";
    else if (why == "face too narrow") help = "a face beside the edge is narrower than the least band that is measured";
    else if (why.rfind("out of", 0) == 0) help = "use a sensor with a larger field or range";
    else if (why == "too few points") help = "use a sensor with a finer pitch";
  }
  return {.code = "inspect.not_covered",
          .where = "feature " + f.feature + ", edge " + f.id + " from " + fixed_number(from, 1) + " to " + fixed_number(to, 1) + " mm",
          .message = "only " + text_percent(f.coverage_ratio) + " % of the edge can be seen on both faces (" + text_percent(shop.recipe->coverage_min_ratio) +
                     " % are wanted); of the views that were tried: " + all + "; " + help,
          .measured = f.coverage_ratio,
          .limit = shop.recipe->coverage_min_ratio,
          .unit = "ratio",
          .stage = kStage};
}

}  // namespace

Result<Location> location_of_fixture(const Job& job) {
  Location l;
  l.T_base_part = job.fixture.T_base_fixture * job.fixture.T_fixture_part;
  Vec6 sd = Vec6::Zero();
  for (int i = 0; i < 3; ++i) {
    sd[i] = job.fixture.play_mm[i] / std::sqrt(3.0);
    if (!job.fixture.play_rad[static_cast<std::size_t>(i)])
      return refuse({.code = "inspect.part_not_located", .where = "fixture.play.rpy[" + std::to_string(i) + "]",
                     .message = "the fixture leaves an angle free, so where the edges are is not known; scan the whole part first and plan from where it was found",
                     .measured = 180, .limit = 10, .unit = "deg", .stage = kStage});
    sd[3 + i] = *job.fixture.play_rad[static_cast<std::size_t>(i)] / std::sqrt(3.0);
  }
  // the play is in the fixture's axes, the covariance in the part's
  const Mat3 R = job.fixture.T_fixture_part.rotation().transpose();
  const Vec3 t2 = sd.head<3>().array().square(), r2 = sd.tail<3>().array().square();
  l.covariance.topLeftCorner<3, 3>() = R * t2.asDiagonal() * R.transpose();
  l.covariance.bottomRightCorner<3, 3>() = R * r2.asDiagonal() * R.transpose();
  return l;
}

Result<Done<Inspection>> plan_inspection(const InspectRecipe& recipe, const Job& job, const Location& location) {
  const auto made = Robot::from(job.cell.robot);
  if (!made) return refuse_all(made.error());
  const Robot& robot = *made;
  RobotSpec free_spec = job.cell.robot;
  for (JointSpec& j : free_spec.joints) j.min_rad = -kPi, j.max_rad = kPi;
  const Robot free_robot = *Robot::from(free_spec);
  const JointVector home = job.cell.robot.home_rad;

  Workshop shop;
  shop.recipe = &recipe, shop.cell_spec = &job.cell, shop.robot = &robot, shop.free_robot = &free_robot;
  shop.edges = stations_of(job, location, recipe.station_mm);
  for (const EdgeStations& e : shop.edges) shop.first_station.push_back(shop.stations_count), shop.stations_count += e.stations.size();
  if (shop.stations_count == 0)
    return refuse({.code = "inspect.nothing_to_do", .where = "part " + job.part.id, .message = "the part has no edge that is to be worked; give it features with edges", .stage = kStage});

  const std::string tool_id = shop.edges.front().recipe != nullptr ? shop.edges.front().recipe->tool : "";
  shop.tool = job.tool(tool_id);
  if (shop.tool == nullptr && tool_id.empty() && !job.cell.tools.empty()) shop.tool = &job.cell.tools.front();
  if (shop.tool == nullptr)
    return refuse({.code = "inspect.tool", .where = "cell.tools", .message = "the program needs the tool '" + tool_id + "' and the cell has none of that name: what rides along while scanning must be known",
                   .measured = 0, .limit = 1, .unit = "tools", .stage = kStage});

  // sensors that can measure an edge at all, the quietest first
  Done<Inspection> done;
  Inspection& plan = done.artefact;
  double best_points = 0;
  for (std::size_t k = 0; k < job.cell.sensors.size(); ++k) {
    shop.eyes.push_back(eye_of(job.cell.sensors[k]));
    if (job.cell.sensors[k].kind == SensorKind::profile) continue;
    const SensorEye& eye = shop.eyes.back();
    const double pitch = eye.pitch_ratio * eye.working_distance_mm;
    const double points = pitch > 0 ? (kBandTo_mm - kBandFrom_mm) * recipe.station_mm / (pitch * pitch) : 0;
    best_points = std::max(best_points, points);
    if (points >= recipe.points_min_count * recipe.points_reserve_ratio) shop.sensors.push_back(static_cast<int>(k));
  }
  if (shop.sensors.empty())
    return refuse({.code = "inspect.sensor", .where = "cell.sensors",
                   .message = "no sensor that takes whole pictures gives " + fixed_number(recipe.points_min_count * recipe.points_reserve_ratio, 0) +
                              " points on a face beside one mm of an edge (the best gives " + fixed_number(best_points, 1) + " at its working distance); use a finer one, or name its pixels in the cell",
                   .measured = best_points, .limit = recipe.points_min_count * recipe.points_reserve_ratio, .unit = "points", .stage = kStage});
  std::stable_sort(shop.sensors.begin(), shop.sensors.end(), [&](int a, int b) {
    return shop.eyes[static_cast<std::size_t>(a)].noise_mm < shop.eyes[static_cast<std::size_t>(b)].noise_mm;
  });
  for (const int s : shop.sensors) plan.assumed.insert(plan.assumed.end(), shop.eyes[static_cast<std::size_t>(s)].assumed.begin(), shop.eyes[static_cast<std::size_t>(s)].assumed.end());
  for (const std::string& a : plan.assumed) done.notes.push_back({Note::Level::warning, "inspect.assumed", a, "cell.sensors"});

  const double place = place_margin_mm(location, shop.edges);
  shop.margin_mm = recipe.aim_margin_mm + place;
  plan.aim_margin_mm = shop.margin_mm;
  double widest = 0, smallest_field = 1e9;
  for (const int s : shop.sensors) {
    const SensorSpec& sensor = job.cell.sensors[static_cast<std::size_t>(s)];
    const double field = std::min(sensor.field_of_view_mm[0], sensor.field_of_view_mm[1]);
    widest = std::max(widest, std::min(0.3 * field, 0.35 * (sensor.range_mm[1] - sensor.range_mm[0])));
    smallest_field = std::min(smallest_field, field);
  }
  if (shop.margin_mm > widest)
    return refuse({.code = "inspect.part_not_located", .where = "item " + job.item_id,
                   .message = "the edges may lie " + text_mm(shop.margin_mm) + " mm off (3 sd, with the aim's margin) and the sensors' fields allow " + text_mm(widest) +
                              " mm; scan the whole part first and plan from where it was found, or hold it better",
                   .measured = shop.margin_mm, .limit = widest, .unit = "mm", .stage = kStage});

  const CellScene cell = cell_scene(robot, job, job.part.brep.mesh, location, *shop.tool, recipe.clearance_mm, kFluteFixture_mm + job.cell.robot.accuracy.absolute.mean_mm, 1.0);
  done.notes.insert(done.notes.end(), cell.notes.begin(), cell.notes.end());
  shop.cell = &cell;
  // stops and moves keep what the part may lie off in addition
  shop.watches = cell.with_flute(recipe.clearance_mm);
  for (Watch& w : shop.watches)
    if (w.a == cell.part || w.b == cell.part) w.margin_mm += std::min(place, 10.0);
  shop.blockers = blockers_of(job, location, *shop.tool);
  const Certificate home_is = cell.scene.certify(shop.watches, {{home}, false});
  if (!home_is.is_free || robot.joint_margin_rad(home) < 0) {
    const bool is_near = !home_is.is_free;
    return refuse({.code = "inspect.home", .where = "robot.home",
                   .message = is_near ? pair_name(cell, shop.watches[static_cast<std::size_t>(home_is.watch)]) + " are " + text_mm(home_is.clearance_mm) + " mm apart with the robot at home; choose another home or correct the cell"
                                      : "home lies outside the joint limits; correct the cell file",
                   .measured = is_near ? home_is.clearance_mm : deg_from_rad(robot.joint_margin_rad(home)), .limit = is_near ? recipe.clearance_mm : 0.0, .unit = is_near ? "mm" : "deg", .stage = kStage});
  }

  // ---- views that can be had
  const auto stretches = stretches_of(shop.edges, std::max(2.0, recipe.stretch_ratio * (smallest_field - 2 * shop.margin_mm)));
  std::vector<ViewCandidate> candidates;
  for (std::size_t i = 0; i < stretches.size(); ++i)
    for (const ViewKind kind : {ViewKind::working, ViewKind::normal}) {
      auto some = views_for(shop, stretches[i], static_cast<int>(i), kind, plan.tried);
      candidates.insert(candidates.end(), std::make_move_iterator(some.begin()), std::make_move_iterator(some.end()));
    }
  std::vector<Bits> sets;
  std::vector<double> price;
  for (const ViewCandidate& c : candidates) sets.push_back(bits_of(shop, c)), price.push_back(price_of(c, home));
  std::vector<char> is_allowed(candidates.size(), 1);
  const RobotErrorModel errors(robot, shop.tool->T_flange_tool);
  const PassTools tools{&robot, &free_robot, &cell, nullptr, shop.tool->T_flange_tool, recipe.joint_margin_rad};

  // ---- choose, order, join; a view that cannot be driven to is left out and the choice made again
  std::optional<Refusal> blocked;
  const auto with_blocked = [&](Refusals reasons) {  // what the views that were left out would have given is said with why they were
    if (blocked) reasons.insert(reasons.begin(), *blocked), reasons.front().code = "inspect.no_transfer", reasons.front().stage = kStage;
    return reasons;
  };
  for (int round = 0; round < kRoundsMax; ++round) {
    std::vector<int> chosen = cover(sets, price, is_allowed);
    const auto forecast_of = [&](const std::vector<int>& list) {
      std::vector<const ViewCandidate*> views;
      for (const int c : list) views.push_back(&candidates[static_cast<std::size_t>(c)]);
      return forecast(shop, errors, views);
    };
    plan.edges = forecast_of(chosen);
    Refusals reasons;
    for (const EdgeForecast& f : plan.edges)
      if (f.coverage_ratio < recipe.coverage_min_ratio) reasons.push_back(not_covered(shop, f, plan.tried));
    if (!reasons.empty()) {
      return refuse_all(with_blocked(reasons));
    }
    // more views while stations are known less well than the recipe leaves: what sees them from a posture too unlike the working one
    const auto lacking = [](const EdgeForecast& f) {
      return f.sd_limit_mm > 0 ? std::count_if(f.sd_mm.begin(), f.sd_mm.end(), [&](double sd) { return std::isfinite(sd) && sd > f.sd_limit_mm; }) : 0;
    };
    for (std::size_t e = 0; e < plan.edges.size(); ++e)
      while (lacking(plan.edges[e]) > 0) {
        int best = -1;
        auto best_lack = lacking(plan.edges[e]);
        for (std::size_t i = 0; i < candidates.size(); ++i) {
          if (!is_allowed[i] || std::find(chosen.begin(), chosen.end(), static_cast<int>(i)) != chosen.end()) continue;
          if (stretches[static_cast<std::size_t>(candidates[i].stretch)].edge != static_cast<int>(e)) continue;
          std::vector<const ViewCandidate*> with;
          for (const int c : chosen) with.push_back(&candidates[static_cast<std::size_t>(c)]);
          with.push_back(&candidates[i]);
          const auto lack = lacking(forecast_edge(shop, errors, with, e));
          if (lack < best_lack) best_lack = lack, best = static_cast<int>(i);
        }
        if (best < 0) break;
        chosen.push_back(best);
        plan.edges = forecast_of(chosen);
      }
    for (std::size_t e = 0; e < plan.edges.size(); ++e) {
      const EdgeForecast& f = plan.edges[e];
      if (f.sd_limit_mm <= 0 || f.share_ratio >= shop.edges[e].recipe->gate_probability_ratio) continue;
      reasons.push_back({.code = "inspect.budget", .where = "feature " + f.feature + ", edge " + f.id,
                         .message = "from all views that can be had a leg would be known to " + fixed_number(f.sd_worst_mm, 3) + " mm (1 sd) where the recipe leaves " + fixed_number(f.sd_limit_mm, 3) +
                                    " mm: only " + text_percent(f.share_ratio) + " % of the edge would be in tolerance; calibrate the sensor's mount better, use a quieter sensor, or widen the tolerance",
                         .measured = f.sd_worst_mm, .limit = f.sd_limit_mm, .unit = "mm", .stage = kStage});
    }
    if (!reasons.empty()) return refuse_all(with_blocked(reasons));

    // order
    std::vector<JointVector> places{home};
    for (const int c : chosen) places.push_back(candidates[static_cast<std::size_t>(c)].q);
    std::vector<std::vector<double>> cost(places.size(), std::vector<double>(places.size(), 0.0));
    for (std::size_t i = 0; i < places.size(); ++i)
      for (std::size_t k = 0; k < places.size(); ++k) cost[i][k] = joint_time_s(job.cell.robot, places[i], places[k], recipe.transfer_speed_ratio);
    const std::vector<int> order = closed_tour(cost);

    // moves
    plan.motion = {}, plan.stops.clear(), plan.views.clear();
    int banned = -1;
    const auto drive = [&](const Transfer& t, int stop) {
      MotionSegment s;
      s.kind = SegmentKind::transfer, s.q_rad = t.q_rad, s.speed_ratio = recipe.transfer_speed_ratio, s.clearance_mm = t.clearance_mm;
      s.speed_mm_s.assign(t.q_rad.size(), 0.0);
      for (const JointVector& q : t.q_rad) {
        s.T_base_tool.push_back(robot.forward(q) * shop.tool->T_flange_tool);
        plan.motion.joint_margin_min_rad = std::min(plan.motion.joint_margin_min_rad, robot.joint_margin_rad(q));
      }
      plan.motion.duration_s += way_time_s(job.cell.robot, t.q_rad, recipe.transfer_speed_ratio);
      plan.motion.clearance_min_mm = std::min(plan.motion.clearance_min_mm, t.clearance_mm);
      plan.motion.segments.push_back(std::move(s)), plan.stops.push_back(stop);
    };
    JointVector at = home;
    for (const int i : order) {
      const ViewCandidate& c = candidates[static_cast<std::size_t>(chosen[static_cast<std::size_t>(i) - 1])];
      const std::string where = "on the way to the view of edge " + shop.edges[static_cast<std::size_t>(stretches[static_cast<std::size_t>(c.stretch)].edge)].id;
      auto t = short_transfer(shop, tools, at, c.q, where);
      if (!t && at != home) {  // over home
        auto back = short_transfer(shop, tools, at, home, where);
        auto there = short_transfer(shop, tools, home, c.q, where);
        if (back && there) {
          drive(*back, -1);
          t = std::move(there);
        }
      }
      if (!t) {
        banned = chosen[static_cast<std::size_t>(i) - 1];
        blocked = t.error().front();
        break;
      }
      ScanView v;
      v.sensor = c.sensor, v.kind = c.kind, v.tilt_rad = c.tilt_rad, v.turn_rad = c.turn_rad, v.distance_mm = c.distance_mm, v.q_rad = c.q;
      v.T_base_flange = robot.forward(c.q), v.clearance_mm = c.clearance_mm, v.joint_margin_rad = robot.joint_margin_rad(c.q);
      const Stretch& stretch = stretches[static_cast<std::size_t>(c.stretch)];
      const EdgeStations& edge = shop.edges[static_cast<std::size_t>(stretch.edge)];
      v.feature = edge.feature, v.edge = edge.id, v.s_from_mm = edge.stations[stretch.begin].s_mm, v.s_to_mm = edge.stations[stretch.end - 1].s_mm;
      for (std::size_t e = 0; e < shop.edges.size(); ++e) {
        std::size_t seen = 0;
        for (std::size_t k = 0; k < shop.edges[e].stations.size(); ++k)
          seen += is_enough(recipe, c.points[2 * (shop.first_station[e] + k)]) && is_enough(recipe, c.points[2 * (shop.first_station[e] + k) + 1]);
        if (seen > 0) v.edges.push_back(shop.edges[e].id), v.edges_ratio.push_back(static_cast<double>(seen) / static_cast<double>(shop.edges[e].stations.size()));
      }
      drive(*t, static_cast<int>(plan.views.size()));
      plan.views.push_back(std::move(v));
      at = c.q;
    }
    if (banned < 0) {
      auto back = short_transfer(shop, tools, at, home, "from the last view to home");
      if (back) {
        drive(*back, -1);
        blocked.reset();
        break;
      }
      banned = chosen[static_cast<std::size_t>(order.back()) - 1], blocked = back.error().front();
    }
    is_allowed[static_cast<std::size_t>(banned)] = 0;
  }
  if (blocked) return refuse_all(with_blocked({}));
  std::map<int, int> number;
  for (ScanView& v : plan.views) {
    const int n = number[v.sensor]++;
    v.name = job.cell.sensors[static_cast<std::size_t>(v.sensor)].id + (n < 10 ? "_0" : "_") + std::to_string(n);
  }
  const auto T_part_base = location.T_base_part.inverse();
  for (EdgeForecast& f : plan.edges)
    for (Vec3& p : f.p_part) p = T_part_base.point(p);
  return done;
}

}  // namespace asbuilt
