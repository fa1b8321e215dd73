// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/unit/locate/synthetic.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "planner/geom/mesh_query.hpp"
#include "planner/robot/error_model.hpp"

namespace asbuilt::synthetic {
namespace {

constexpr double kStepRad = rad_from_deg(1.0);

Vec3 polar(double angle, double radius, double z) { return {radius * std::cos(angle), radius * std::sin(angle), z}; }

struct Ring {  // samples of the outline and which run each step belongs to
  std::vector<double> angle, radius;
  std::vector<int> run;
};

Ring sample(const std::vector<Corner>& outline) {
  Ring ring;
  const int n = static_cast<int>(outline.size());
  for (int i = 0; i < n; ++i) {
    const Corner &a = outline[static_cast<std::size_t>(i)], &b = outline[static_cast<std::size_t>((i + 1) % n)];
    double sweep = b.angle_rad - a.angle_rad;
    if (sweep <= -1e-12 || (n == 1)) sweep += 2 * kPi;
    const int steps = std::max(1, static_cast<int>(std::ceil(sweep / kStepRad)));
    for (int k = 0; k < steps; ++k) {
      const double u = static_cast<double>(k) / steps;
      if (std::abs(a.radius_mm - b.radius_mm) < 1e-9) {
        ring.angle.push_back(a.angle_rad + u * sweep), ring.radius.push_back(a.radius_mm);
      } else {
        const Vec3 p = (1 - u) * polar(a.angle_rad, a.radius_mm, 0) + u * polar(b.angle_rad, b.radius_mm, 0);
        ring.angle.push_back(std::atan2(p.y(), p.x())), ring.radius.push_back(p.head<2>().norm());
      }
      ring.run.push_back(i);
    }
  }
  return ring;
}

BrepEdge make_edge(const std::string& id, std::vector<Vec3> points, int face_1, int face_2, const Vec3& n_1, bool is_closed) {
  BrepEdge e;
  e.id = id, e.face_1 = face_1, e.face_2 = face_2, e.kind = EdgeKind::sharp_convex, e.is_closed = is_closed;
  e.dihedral_rad = kPi / 2, e.curve_type = "polyline";
  e.curve.shape = PolylineCurve{points};
  e.p = std::move(points);
  for (std::size_t i = 0; i < e.p.size(); ++i) {
    e.s_mm.push_back(i == 0 ? 0 : e.s_mm.back() + (e.p[i] - e.p[i - 1]).norm());
    const Vec3 t = (e.p[std::min(i + 1, e.p.size() - 1)] - e.p[i > 0 ? i - 1 : 0]).normalized();
    e.tangent.push_back(t), e.n_1.push_back(n_1), e.n_2.push_back(t.cross(Vec3::UnitZ()).normalized());
  }
  e.length_mm = e.s_mm.back();
  return e;
}

Surface plane(const Vec3& origin, const Vec3& n, const Vec3& x) { return {PlaneSurface{Placement{origin, x, n.cross(x), n}}}; }

}  // namespace

PartSpec make_part(const std::vector<Corner>& outline, double hole, double height) {
  PartSpec part;
  part.id = "synthetic", part.material = "steel", part.cad_file = "none";
  Brep& b = part.brep;
  b.units = "mm", b.solids_count = b.shells_count = 1;
  const Ring ring = sample(outline);
  const int n = static_cast<int>(ring.angle.size()), runs = static_cast<int>(outline.size());
  const auto face = [&](const std::string& id, Surface s, bool same) {
    BrepFace f;
    f.id = id, f.surface = std::move(s), f.same_sense = same;
    b.faces.push_back(f);
  };
  face("#top", plane({0, 0, height}, Vec3::UnitZ(), Vec3::UnitX()), true);
  face("#bottom", plane({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX()), false);
  face("#hole", {CylinderSurface{Placement{}, hole}}, false);
  for (int i = 0; i < runs; ++i) {
    const Corner &a = outline[static_cast<std::size_t>(i)], &c = outline[static_cast<std::size_t>((i + 1) % runs)];
    if (std::abs(a.radius_mm - c.radius_mm) < 1e-9) {
      face("#side" + std::to_string(i), {CylinderSurface{Placement{}, a.radius_mm}}, true);
    } else {
      const Vec3 p = polar(a.angle_rad, a.radius_mm, 0), t = (polar(c.angle_rad, c.radius_mm, 0) - p).normalized();
      face("#side" + std::to_string(i), plane(p, t.cross(Vec3::UnitZ()), t), true);
    }
  }
  for (int i = 0; i < n; ++i) {
    const double a = ring.angle[static_cast<std::size_t>(i)], r = ring.radius[static_cast<std::size_t>(i)];
    b.mesh.vertices.push_back(polar(a, r, 0)), b.mesh.vertices.push_back(polar(a, r, height));
    b.mesh.vertices.push_back(polar(a, hole, 0)), b.mesh.vertices.push_back(polar(a, hole, height));
  }
  const auto quad = [&](int p, int q, int r, int s, int f) {
    b.mesh.triangles.push_back({p, q, r}), b.mesh.triangles.push_back({p, r, s});
    b.triangle_face.push_back(f), b.triangle_face.push_back(f);
  };
  for (int i = 0; i < n; ++i) {
    const int o = 4 * i, m = 4 * ((i + 1) % n);
    quad(o, m, m + 1, o + 1, 3 + ring.run[static_cast<std::size_t>(i)]);
    quad(m + 2, o + 2, o + 3, m + 3, 2);
    quad(o + 1, m + 1, m + 3, o + 3, 0);
    quad(m, o, o + 2, m + 2, 1);
  }
  for (std::size_t t = 0; t < b.mesh.triangles.size(); ++t)
    for (const int v : b.mesh.triangles[t]) b.faces[static_cast<std::size_t>(b.triangle_face[t])].box.extend(b.mesh.vertices[static_cast<std::size_t>(v)]);
  b.box = b.mesh.box();
  for (const double z : {height, 0.0}) {
    const std::string name = z > 0 ? "top-" : "bottom-";
    for (int i = 0; i < runs; ++i) {
      std::vector<Vec3> p;
      for (int k = 0; k < n; ++k)
        if (ring.run[static_cast<std::size_t>(k)] == i) p.push_back(polar(ring.angle[static_cast<std::size_t>(k)], ring.radius[static_cast<std::size_t>(k)], z));
      const Corner& next = outline[static_cast<std::size_t>((i + 1) % runs)];
      p.push_back(polar(next.angle_rad, next.radius_mm, z));
      b.edges.push_back(make_edge(name + std::to_string(i), p, z > 0 ? 0 : 1, 3 + i, z > 0 ? Vec3::UnitZ() : Vec3(-Vec3::UnitZ()), runs == 1));
    }
    std::vector<Vec3> p;
    for (int k = 0; k <= 360; ++k) p.push_back(polar(rad_from_deg(k), hole, z));
    b.edges.push_back(make_edge(z > 0 ? "hole-top" : "hole-bottom", p, z > 0 ? 0 : 1, 2, z > 0 ? Vec3::UnitZ() : Vec3(-Vec3::UnitZ()), true));
  }
  return part;
}

PartSpec make_ring(int lugs_count, double wider_mm) {
  const double outer = 130, lug = 150, half = 13 / lug;
  std::vector<Corner> outline;
  if (lugs_count == 0) outline.push_back({0, outer});
  for (int i = 0; i < lugs_count; ++i) {
    const double middle = 2 * kPi * i / lugs_count, h = half + (i == 0 ? 0.5 * wider_mm / lug : 0.0);
    outline.push_back({middle - h * 1.02, outer}), outline.push_back({middle - h, lug});
    outline.push_back({middle + h, lug}), outline.push_back({middle + h * 1.02, outer});
  }
  PartSpec part = make_part(outline, 110, 40);
  part.id = "ring";
  part.symmetry = Symmetry{};
  return part;
}

PartSpec make_bracket(bool is_mirrored) {
  const std::vector<std::pair<double, double>> xy{{80, -45}, {80, 10}, {42, 30}, {42, 62}, {-20, 62}, {-64, 35}, {-95, -20}, {-60, -45}};
  std::vector<Corner> outline;
  for (const auto& [x, y] : xy) outline.push_back({std::atan2(is_mirrored ? -y : y, x), std::hypot(x, y)});
  if (is_mirrored) std::reverse(outline.begin(), outline.end());
  std::sort(outline.begin(), outline.end(), [](const Corner& a, const Corner& b) { return a.angle_rad < b.angle_rad; });
  PartSpec part = make_part(outline, 18, 34);
  part.id = "bracket";
  return part;
}

void add_feature(PartSpec& part, const std::string& id, const std::vector<std::string>& edge_ids) {
  FeatureSpec f;
  f.id = id, f.recipe = "deburr";
  for (std::size_t e = 0; e < part.brep.edges.size(); ++e)
    if (std::find(edge_ids.begin(), edge_ids.end(), part.brep.edges[e].id) != edge_ids.end()) f.edges.push_back(static_cast<int>(e));
  part.features.push_back(f);
}

Job make_job(PartSpec part, bool is_free_about_z) {
  Job job;
  job.batch_id = "synthetic", job.item_id = "one", job.taken = "2026-11-22";
  RobotSpec& r = job.cell.robot;
  r.model = "six axes, 2.39 m";
  OpwParameters k;
  k.a1_mm = 300, k.a2_mm = -150, k.c1_mm = 750, k.c2_mm = 1000, k.c3_mm = 1080, k.c4_mm = 220;
  k.offsets_rad = {0, -kPi / 2, 0, 0, 0, 0}, k.signs = {-1, 1, 1, -1, 1, -1};
  r.kinematics = k;
  const double limits[6][2] = {{-180, 180}, {-150, 20}, {-110, 150}, {-270, 270}, {-122, 122}, {-350, 350}};
  for (std::size_t i = 0; i < 6; ++i) r.joints[i] = {rad_from_deg(limits[i][0]), rad_from_deg(limits[i][1]), 2, 6, 40};
  r.home_rad = {0, rad_from_deg(-100), rad_from_deg(100), 0, kPi / 2, 0};
  r.accuracy = {{0.42, 0.2}, {0.07, 0.03}, {0.02, 0.01}};
  ToolSpec tool;
  tool.id = "cone", tool.number = 1;
  tool.T_flange_tool = {Eigen::Quaterniond::Identity(), Vec3(0, 0, 350)};
  job.cell.tools.push_back(tool);
  SensorSpec wide;
  wide.id = "wide", wide.is_calibrated = true, wide.range_mm = {380, 770}, wide.working_distance_mm = 500, wide.field_of_view_mm = {565, 356};
  wide.noise_mm = 0.18;
  wide.T_flange_sensor = {quat_from_z(Vec3::UnitZ(), Vec3::UnitY()), Vec3(-150, 0, 150)};
  wide.covariance.diagonal() << 0.0058, 0.0058, 0.0033, 1e-8, 1e-8, 1e-8;
  SensorSpec detail = wide;
  detail.id = "detail", detail.range_mm = {171, 241}, detail.working_distance_mm = 206, detail.field_of_view_mm = {120, 75}, detail.noise_mm = 0.006;
  detail.T_flange_sensor = {quat_from_z(Vec3(-0.575, 0, 0.818), Vec3::UnitY()), Vec3(118, 0, 201)};
  detail.covariance.diagonal() << 2.4e-4, 2.4e-4, 1.3e-4, 2.5e-9, 2.5e-9, 2.5e-9;
  job.cell.sensors = {wide, detail};
  Recipe recipe;
  recipe.id = "deburr", recipe.tool = "cone", recipe.width_mm = 0.4, recipe.tolerance_mm = 0.1;
  job.recipes.push_back(recipe);
  FixtureSpec& f = job.fixture;
  f.T_base_fixture = {quat_from_zyx(0.12, 0, 0), Vec3(1230, -40, 640)};
  f.T_fixture_part = {Eigen::Quaterniond::Identity(), Vec3(0, 0, 20)};
  f.play_mm = {6, 6, 3};
  f.play_rad = {rad_from_deg(1), rad_from_deg(1), is_free_about_z ? std::nullopt : std::optional<double>(rad_from_deg(4))};
  f.mesh_fixture.vertices = {{-200, -200, 0}, {200, -200, 0}, {200, 200, 0}, {-200, 200, 0}};
  f.mesh_fixture.triangles = {{0, 1, 2}, {0, 2, 3}};
  job.part = std::move(part);
  return job;
}

std::vector<View> usual_views(const std::vector<std::pair<std::string, Vec3>>& aims, bool with_wide_sides) {
  std::vector<View> views;
  for (int i = 0; i < 4; ++i) {
    View v;
    const double a = kPi / 4 + i * kPi / 2;
    v.from_part = with_wide_sides ? Vec3(0.7 * std::cos(a), 0.7 * std::sin(a), 0.72).normalized() : Vec3(0.02 * std::cos(a), 0.02 * std::sin(a), 1).normalized();
    views.push_back(v);
  }
  for (const auto& [feature, aim] : aims) {
    for (const double turn : {0.0, kPi}) {
      View v;
      v.sensor = 1, v.aim_part = aim, v.feature = feature, v.is_working = true, v.turn_rad = turn;
      views.push_back(v);
    }
    const Vec3 out = Vec3(aim.x(), aim.y(), 0).normalized();
    for (const double side : {0.8, -0.5}) {
      View v;
      v.sensor = 1, v.aim_part = aim, v.feature = feature;
      v.from_part = (out * 1.0 + side * Vec3::UnitZ().cross(out) + 1.3 * Vec3::UnitZ()).normalized();
      v.turn_rad = side;
      views.push_back(v);
    }
  }
  return views;
}

Truth scan(Job& job, const std::vector<View>& views, const ScanOptions& o) {
  Truth truth;
  const auto robot = Robot::from(job.cell.robot);
  must(robot.has_value(), "synthetic: robot");
  const ToolSpec& tool = job.cell.tools.front();
  const RobotErrorModel model(*robot, tool.T_flange_tool);
  Random random = Random::stream(o.seed, "synthetic");
  truth.arm = Eigen::VectorXd::Zero(model.size());
  for (double& x : truth.arm) x = o.robot_ratio * random.normal();
  const Pose<frame::Base, frame::Part> nominal = job.fixture.T_base_fixture * job.fixture.T_fixture_part;
  truth.T_base_part = nominal * o.play;
  {  // Sensors and tool are calibrated on this arm, by a score of poses about the fixture: what they see on average is theirs for good.
    Random poses = Random::stream(o.seed, "calibration poses");
    JointVector home{};
    for (std::size_t i = 0; i < 6; ++i) home[i] = job.cell.robot.home_rad[i];
    int count = 0;
    for (int i = 0; i < 200 && count < 24; ++i) {
      const Eigen::Quaterniond q_tool = quat_from_zyx(poses.uniform(-kPi, kPi), poses.uniform(-0.6, 0.6), poses.uniform(-0.6, 0.6)) * quat_from_z(-Vec3::UnitZ(), Vec3::UnitX());
      const Vec3 at = nominal.point(job.part.brep.mesh.box().center_mm()) + 60 * Vec3(poses.uniform(-1, 1), poses.uniform(-1, 1), poses.uniform(-1, 1));
      const auto q = robot->inverse_like(Pose<frame::Base, frame::Tool>(q_tool, at) * tool.T_flange_tool.inverse(), home);
      if (q) truth.calibrated += model.twist(*q) * truth.arm, ++count;
    }
    must(count > 0, "synthetic: nothing to calibrate in");
    truth.calibrated /= count;
  }
  const PartSpec& real = o.scanned_part ? *o.scanned_part : job.part;
  Mesh mesh = real.brep.mesh;
  Mesh scene_mesh = transformed(truth.T_base_part, mesh);
  const int part_triangles = static_cast<int>(mesh.triangles.size());
  {
    const int first = static_cast<int>(scene_mesh.vertices.size());
    for (const Vec3& v : job.fixture.mesh_fixture.vertices) scene_mesh.vertices.push_back(job.fixture.T_base_fixture.point(v));
    for (const auto& t : job.fixture.mesh_fixture.triangles) scene_mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
  }
  std::vector<double> form(real.brep.faces.size());
  for (double& x : form) x = o.form_mm * random.normal();
  const MeshQuery query(scene_mesh);
  std::vector<Pose<frame::Flange, frame::Sensor>> true_sensors;
  for (std::size_t s = 0; s < job.cell.sensors.size(); ++s) {
    Vec6 xi;
    for (int i = 0; i < 6; ++i) xi[i] = o.hand_eye_ratio * random.normal() * std::sqrt(job.cell.sensors[s].covariance(i, i));
    if (s == 1) xi.head<3>() += o.detail_hand_eye_fault_mm;
    true_sensors.push_back(job.cell.sensors[s].T_flange_sensor.disturbed(xi));
  }
  JointVector home{};
  for (std::size_t i = 0; i < 6; ++i) home[i] = job.cell.robot.home_rad[i];
  const Vec3 axis = job.recipes.front().axis_base;
  job.captures.clear();
  int number = 0;
  for (const View& v : views) {
    const SensorSpec& sensor = job.cell.sensors[static_cast<std::size_t>(v.sensor)];
    const Vec3 aim = nominal.point(v.aim_part);
    Pose<frame::Base, frame::Flange> flange;
    if (v.is_working) {
      flange.q = quat_from_z(axis, Eigen::AngleAxisd(v.turn_rad, axis) * Vec3::UnitX());
      const Pose<frame::Base, frame::Sensor> at(flange.q * sensor.T_flange_sensor.q, Vec3::Zero());
      flange.p_mm = aim - at.direction(Vec3::UnitZ()) * sensor.working_distance_mm - flange.q * sensor.T_flange_sensor.p_mm;
    } else {
      // Of twelve rolls about the line of sight the one that bends the wrist least.
      const Vec3 from = nominal.direction(v.from_part);
      double best = 1e9;
      for (int roll = 0; roll < 12; ++roll) {
        const Eigen::Quaterniond q = quat_from_z(-from, Eigen::AngleAxisd(v.turn_rad + roll * kPi / 6, from) * Vec3(0.3, 1, 0.1));
        const Pose<frame::Base, frame::Sensor> at(q, aim + from * sensor.working_distance_mm);
        const Pose<frame::Base, frame::Flange> candidate = at * sensor.T_flange_sensor.inverse();
        const auto joints = robot->inverse_like(candidate, home);
        if (!joints) continue;
        double farthest = 0;
        for (std::size_t i = 0; i < 6; ++i) farthest = std::max(farthest, (i == 5 ? 0.5 : 1.0) * std::abs((*joints)[i] - home[i]));
        if (farthest < best) best = farthest, flange = candidate;
      }
    }
    auto q = robot->inverse_like(flange, home);
    if (!q) continue;
    Vec6 xi = model.twist(*q) * truth.arm - truth.calibrated;
    const Mat6 scatter = model.scatter(*q);
    Vec6 white;
    for (double& x : white) x = random.normal();
    xi += o.robot_ratio * (Eigen::SelfAdjointEigenSolver<Mat6>(scatter).operatorSqrt() * white);
    const Pose<frame::Base, frame::Flange> real_flange = flange.disturbed(xi);
    truth.T_base_flange_true.push_back(real_flange);
    const Pose<frame::Base, frame::Sensor> eye = real_flange * true_sensors[static_cast<std::size_t>(v.sensor)];
    truth.T_base_sensor_true.push_back(eye);
    Capture c;
    c.name = (v.sensor == 0 ? "wide_" : "detail_") + std::to_string(number++) + ".ply";
    c.sensor = v.sensor, c.T_base_flange = flange;
    if (!v.feature.empty()) c.feature = v.feature;
    const int nu = v.sensor == 0 ? o.wide_pixels : o.detail_pixels;
    const double pitch = sensor.field_of_view_mm[0] / sensor.working_distance_mm / nu;
    const int nv = static_cast<int>(sensor.field_of_view_mm[1] / sensor.working_distance_mm / pitch);
    for (int j = 0; j < nv; ++j) {
      for (int i = 0; i < nu; ++i) {
        const Vec3 d_sensor = Vec3((i - 0.5 * nu + 0.5) * pitch, (j - 0.5 * nv + 0.5) * pitch, 1).normalized();
        const Vec3 d = eye.direction(d_sensor);
        const auto hit = query.first_hit(eye.p_mm, d, 2 * sensor.range_mm[1]);
        if (!hit) continue;
        const Vec3 n = scene_mesh.triangle_normal(hit->triangle);
        const double cosine = -n.dot(d);
        if (cosine < 0.2) continue;
        double range = hit->distance_mm;
        if (hit->triangle < part_triangles && !form.empty())
          range -= form[static_cast<std::size_t>(real.brep.triangle_face[static_cast<std::size_t>(hit->triangle)])] / cosine;
        range += o.noise_ratio * sensor.noise_mm * random.normal() / cosine;
        const Vec3 p = range * d_sensor;
        if (p.z() < sensor.range_mm[0] || p.z() > sensor.range_mm[1]) continue;
        c.points_sensor.push_back(p.cast<float>());
      }
    }
    job.captures.push_back(std::move(c));
  }
  return truth;
}

}  // namespace asbuilt::synthetic
