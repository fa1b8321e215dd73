// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/files.hpp"

#include <fmt/format.h>

#include <cstring>
#include <fstream>

#include "planner/base/number.hpp"
#include "planner/base/result.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt::simulate_detail {
namespace {

std::string num(double v, int decimals = 6) { return shortest_number(rounded(v, decimals)); }
std::string list(std::initializer_list<double> values) {
  std::string t;
  for (double v : values) t += (t.empty() ? "" : ", ") + num(v, 9);
  return "[" + t + "]";
}

}  // namespace

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream f(file, std::ios::binary);
  f << text;
  must(f.good(), "cannot write " + file.string());
}

void write_stl(const std::filesystem::path& file, const Mesh& mesh) {
  std::string b(80, ' ');
  const auto put = [&](const void* p, std::size_t n) { b.append(static_cast<const char*>(p), n); };
  const std::uint32_t n = static_cast<std::uint32_t>(mesh.triangles.size());
  put(&n, 4);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vec3 normal = mesh.triangle_normal(static_cast<int>(t));
    const auto put3 = [&](const Vec3& v) {
      const Eigen::Vector3f f = v.cast<float>();
      put(f.data(), 12);
    };
    put3(normal);
    for (int k : mesh.triangles[t]) put3(mesh.vertices[k]);
    b.append(2, '\0');
  }
  write_text(file, b);
}

void write_cloud(const std::filesystem::path& file, const std::vector<Eigen::Vector3f>& points) {
  std::string b = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment sensor frame, mm\nelement vertex {}\nproperty float x\nproperty float y\nproperty float "
      "z\nend_header\n",
      points.size());
  for (const Eigen::Vector3f& p : points) b.append(reinterpret_cast<const char*>(p.data()), 12);
  write_text(file, b);
}

std::string pose_text(const Eigen::Quaterniond& q_in, const Vec3& p) {
  Eigen::Quaterniond q = q_in;
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  return "{xyz: " + list({p.x(), p.y(), p.z()}) + ", quat: " + list({q.w(), q.x(), q.y(), q.z()}) + "}";
}

std::string pose_text_zyx(const Eigen::Quaterniond& q, const Vec3& p) {
  const Mat3 R = q.toRotationMatrix();
  const double b = std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0)));
  const double a = std::atan2(R(1, 0), R(0, 0)), c = std::atan2(R(2, 1), R(2, 2));
  return "{xyz: " + list({p.x(), p.y(), p.z()}) + ", zyx: " + list({deg_from_rad(a), deg_from_rad(b), deg_from_rad(c)}) + "}";
}

std::string joints_text(const std::array<double, 6>& q) {
  return "{joints: " + list({deg_from_rad(q[0]), deg_from_rad(q[1]), deg_from_rad(q[2]), deg_from_rad(q[3]), deg_from_rad(q[4]), deg_from_rad(q[5])}) +
         "}";
}

Mesh box_mesh(const Vec3& a, const Vec3& b) {
  Mesh m;
  for (int i = 0; i < 8; ++i) m.vertices.emplace_back(i & 1 ? b.x() : a.x(), i & 2 ? b.y() : a.y(), i & 4 ? b.z() : a.z());
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return m;
}

Mesh cylinder_mesh(double radius, double z0, double z1, int sides) {
  Mesh m;
  for (int k = 0; k < sides; ++k) {
    const double a = 2 * kPi * k / sides;
    m.vertices.emplace_back(radius * std::cos(a), radius * std::sin(a), z0);
    m.vertices.emplace_back(radius * std::cos(a), radius * std::sin(a), z1);
  }
  m.vertices.emplace_back(0, 0, z0);
  m.vertices.emplace_back(0, 0, z1);
  for (int k = 0; k < sides; ++k) {
    const int a = 2 * k, b = 2 * ((k + 1) % sides);
    m.triangles.push_back({a, b, b + 1}), m.triangles.push_back({a, b + 1, a + 1});
    m.triangles.push_back({2 * sides, b, a}), m.triangles.push_back({2 * sides + 1, a + 1, b + 1});
  }
  return m;
}

void append(Mesh& to, const Mesh& more) {
  const int n = static_cast<int>(to.vertices.size());
  to.vertices.insert(to.vertices.end(), more.vertices.begin(), more.vertices.end());
  for (auto t : more.triangles) to.triangles.push_back({t[0] + n, t[1] + n, t[2] + n});
}

CellSpec virtual_cell() {
  CellSpec c;
  c.id = "virtual-cell";
  RobotSpec& r = c.robot;
  r.model = "six-axis 2.2 m (virtual)";
  OpwParameters k;
  k.a1_mm = 280, k.a2_mm = -130, k.c1_mm = 700, k.c2_mm = 920, k.c3_mm = 980, k.c4_mm = 200;
  k.offsets_rad = {0, -kPi / 2, 0, 0, 0, 0};
  k.signs = {-1, 1, 1, -1, 1, -1};
  r.kinematics = k;
  const double lo[6] = {-175, -145, -115, -300, -122, -350}, hi[6] = {175, 20, 150, 300, 122, 350};
  const double v[6] = {110, 105, 110, 180, 175, 250}, a[6] = {330, 330, 330, 580, 580, 780}, j[6] = {2400, 2400, 2400, 3800, 3800, 5600};
  for (int i = 0; i < 6; ++i)
    r.joints[i] = {rad_from_deg(lo[i]), rad_from_deg(hi[i]), rad_from_deg(v[i]), rad_from_deg(a[i]), rad_from_deg(j[i])};
  r.home_rad = {0, rad_from_deg(-100), rad_from_deg(100), 0, rad_from_deg(90), 0};
  r.accuracy.absolute = {0.42, 0.2};
  r.accuracy.repeatability = {0.07, 0.03};
  r.accuracy.short_term = {0.02, 0.01};

  // links drawn upright (theta = 0), then moved to where they are with every joint at 0
  const double z3 = k.c1_mm + k.c2_mm, x4 = k.a1_mm + k.a2_mm, z5 = z3 + k.c3_mm;
  std::vector<Mesh> upright;
  upright.push_back(cylinder_mesh(230, 0, 320, 24));
  upright.push_back(box_mesh(Vec3(-190, -190, 330), Vec3(k.a1_mm + 100, 190, k.c1_mm + 110)));
  upright.push_back(box_mesh(Vec3(k.a1_mm - 95, -240, k.c1_mm - 95), Vec3(k.a1_mm + 95, -80, z3 + 95)));
  upright.push_back(box_mesh(Vec3(x4 - 110, -75, z3 - 120), Vec3(k.a1_mm + 90, 110, z3 + 230)));
  upright.push_back(transformed(Pose<frame::Base, frame::Base>(Eigen::Quaterniond::Identity(), Vec3(x4, 0, 0)), cylinder_mesh(70, z3 + 235, z5 - 95, 20)));
  upright.push_back(box_mesh(Vec3(x4 - 62, -72, z5 - 85), Vec3(x4 + 62, 72, z5 + 95)));
  upright.push_back(
      transformed(Pose<frame::Base, frame::Base>(Eigen::Quaterniond::Identity(), Vec3(x4, 0, 0)), cylinder_mesh(58, z5 + 100, z5 + k.c4_mm, 20)));
  const auto robot = Robot::from(r);
  must(robot.has_value(), "the virtual robot's kinematics were refused");
  JointVector q_upright{};
  for (int i = 0; i < 6; ++i) q_upright[i] = k.offsets_rad[i] * k.signs[i];
  const auto motion = robot->link_motion(q_upright);
  for (int i = 0; i < 7; ++i) r.links.push_back({i, transformed(motion[i].inverse(), upright[i])});

  ToolSpec t;
  t.id = "cone-90";
  t.number = 1;
  t.T_flange_tool = {Eigen::Quaterniond::Identity(), Vec3(0, 0, 330)};
  t.cutter.shape = CutterShape::cone;
  t.cutter.included_angle_rad = kPi / 2;
  t.cutter.tip_diameter_mm = 1, t.cutter.diameter_mm = 8, t.cutter.length_mm = 52, t.cutter.shank_diameter_mm = 8, t.cutter.teeth_count = 4;
  t.spindle = {16000, 5, 1};
  t.mesh_flange = cylinder_mesh(42, 0, 160, 24);
  append(t.mesh_flange, cylinder_mesh(26, 160, 262, 20));
  append(t.mesh_flange, cylinder_mesh(12, 262, 278, 16));
  c.tools = {t};

  SensorSpec wide;
  wide.id = "wide";
  wide.T_flange_sensor = {Eigen::Quaterniond(Eigen::AngleAxisd(kPi / 2, Vec3::UnitZ())), Vec3(-150, 0, 130)};
  wide.range_mm = {370, 760}, wide.working_distance_mm = 500, wide.field_of_view_mm = {540, 340}, wide.noise_mm = 0.18;
  wide.pixels_count = {245, 154}, wide.second_ray_mm = Vec3(140, 0, 0), wide.incidence_max_rad = rad_from_deg(68);
  wide.mesh_flange = box_mesh(Vec3(-195, -110, 20), Vec3(-105, 110, 118));
  const double tilt = rad_from_deg(33), focus = 342, z0 = 200;
  SensorSpec detail;
  detail.id = "detail";
  const Vec3 look(-std::sin(tilt), 0, std::cos(tilt));
  detail.T_flange_sensor = {quat_from_z(look, Vec3::UnitY()), Vec3(0, 0, focus) - z0 * look};
  detail.range_mm = {165, 236}, detail.working_distance_mm = z0, detail.field_of_view_mm = {92, 64}, detail.noise_mm = 0.006;
  detail.pixels_count = {306, 213}, detail.second_ray_mm = Vec3(90, 0, 0), detail.incidence_max_rad = rad_from_deg(68);
  detail.mesh_flange = box_mesh(Vec3(96, -60, 60), Vec3(180, 60, 158));
  c.sensors = {wide, detail};
  c.obstacles = {{"table", box_mesh(Vec3(750, -450, 500), Vec3(1550, 450, 590))}};
  return c;
}

std::string cell_text(const CellSpec& c) {
  const RobotSpec& r = c.robot;
  const OpwParameters& k = std::get<OpwParameters>(r.kinematics);
  std::string t = "asbuilt: cell/1\nid: " + c.id + "\nrobot:\n  model: " + r.model + "\n  kinematics:\n    opw: {";
  t += fmt::format("a1: {}, a2: {}, b: {}, c1: {}, c2: {}, c3: {}, c4: {}", num(k.a1_mm), num(k.a2_mm), num(k.b_mm), num(k.c1_mm), num(k.c2_mm),
                   num(k.c3_mm), num(k.c4_mm));
  std::string offsets, signs, home;
  for (int i = 0; i < 6; ++i) {
    offsets += (i ? ", " : "") + num(deg_from_rad(k.offsets_rad[i]));
    signs += (i ? ", " : "") + std::to_string(k.signs[i]);
    home += (i ? ", " : "") + num(deg_from_rad(r.home_rad[i]));
  }
  t += ", offsets: [" + offsets + "], signs: [" + signs + "]}\n  joints:\n";
  for (const JointSpec& j : r.joints)
    t += fmt::format("  - {{min: {}, max: {}, speed: {}, acceleration: {}, jerk: {}}}\n", num(deg_from_rad(j.min_rad)), num(deg_from_rad(j.max_rad)),
                     num(deg_from_rad(j.speed_rad_s)), num(deg_from_rad(j.acceleration_rad_s2)), num(deg_from_rad(j.jerk_rad_s3)));
  t += "  links:\n";
  for (std::size_t i = 0; i < r.links.size(); ++i) t += fmt::format("  - {{mesh: meshes/link{}.stl, joint: {}}}\n", i, r.links[i].joint);
  t += "  home: {joints: [" + home + "]}\n  accuracy:\n";
  const auto mean_sd = [&](const char* name, const MeanSd& m) { return fmt::format("    {}: {{mean: {}, sd: {}}}\n", name, num(m.mean_mm), num(m.sd_mm)); };
  t += mean_sd("absolute", r.accuracy.absolute) + mean_sd("repeatability", r.accuracy.repeatability) + mean_sd("short_term", r.accuracy.short_term);
  t += "controller:\n  language: krl\n  inform: {pulses_per_degree: [1435.64, 1435.64, 1365.33, 1137.78, 1137.78, 910.22], speed_unit: mm/s}\n"
       "  beckhoff: {orientation: cba, kinematic_id: 45}\ntools:\n";
  for (const ToolSpec& x : c.tools)
    t += fmt::format(
        "- id: {}\n  number: {}\n  flange_tool: {}\n  cutter: {{shape: {}, included_angle: {}, tip_diameter: {}, diameter: {}, length: {}, "
        "shank_diameter: {}, teeth: {}}}\n  mesh: meshes/tool.stl\n  spindle: {{max_rpm: {}, output: {}, analog: {}}}\n",
        x.id, x.number, pose_text(x.T_flange_tool), std::string(name_of(x.cutter.shape)), num(deg_from_rad(x.cutter.included_angle_rad)),
        num(x.cutter.tip_diameter_mm), num(x.cutter.diameter_mm), num(x.cutter.length_mm), num(x.cutter.shank_diameter_mm), x.cutter.teeth_count,
        num(x.spindle.max_rpm), x.spindle.output, x.spindle.analog);
  t += "sensors:\n";
  for (const SensorSpec& x : c.sensors)
    t += fmt::format(
        "- id: {0}\n  kind: snapshot\n  flange_sensor: {1}\n  range: [{2}, {3}]\n  working_distance: {4}\n  field_of_view: [{5}, {6}]\n  noise: {7}\n"
        "  pixels: [{8}, {9}]\n  second_ray: [{10}, {11}, {12}]\n  incidence: {13}\n  mesh: meshes/{0}.stl\n",
        x.id, pose_text(x.T_flange_sensor), num(x.range_mm[0]), num(x.range_mm[1]), num(x.working_distance_mm), num(x.field_of_view_mm[0]),
        num(x.field_of_view_mm[1]), num(x.noise_mm), num((*x.pixels_count)[0]), num((*x.pixels_count)[1]),
        num(x.second_ray_mm->x()), num(x.second_ray_mm->y()), num(x.second_ray_mm->z()), num(deg_from_rad(*x.incidence_max_rad)));
  t += "obstacles:\n- mesh: meshes/table.stl\n  base_obstacle: {xyz: [0, 0, 0], quat: [1, 0, 0, 0]}\n";
  return t;
}

void write_cell_meshes(const std::filesystem::path& folder, const CellSpec& c) {
  for (std::size_t i = 0; i < c.robot.links.size(); ++i) write_stl(folder / "meshes" / fmt::format("link{}.stl", i), c.robot.links[i].mesh);
  write_stl(folder / "meshes/tool.stl", c.tools[0].mesh_flange);
  for (const SensorSpec& s : c.sensors) write_stl(folder / "meshes" / (s.id + ".stl"), s.mesh_flange);
  write_stl(folder / "meshes/table.stl", c.obstacles[0].mesh_base);
}

}  // namespace asbuilt::simulate_detail
