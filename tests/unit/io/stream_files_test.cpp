// SPDX-License-Identifier: GPL-3.0-or-later
// Robot logs, depth images, profiles and what lies beside them: round trips, the dirt real logs carry, and every refusal.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "planner/base/random.hpp"
#include "planner/io/csv_table.hpp"
#include "planner/io/depth_image.hpp"
#include "planner/io/file.hpp"
#include "planner/io/robot_log.hpp"
#include "planner/io/stream_files.hpp"

namespace asbuilt {
namespace {

std::string packet(long ipoc, double x, const std::string& more = "") {
  return "<Rob Type=\"KUKA\"><RIst X=\"" + std::to_string(x) + "\" Y=\"20.5\" Z=\"900\" A=\"10\" B=\"20\" C=\"30\"/>" + more + "<Delay D=\"0\"/><IPOC>" + std::to_string(ipoc) + "</IPOC></Rob>\n";
}
std::string code_of(const Result<RobotLog>& r) { return r ? "" : r.error()[0].code; }

TEST(RobotLog, rsi_packets_are_put_in_order_and_counted_once) {
  std::string text;
  for (int i = 0; i < 40; ++i) {
    if (i == 10 || i == 11 || i == 12) continue;                 // lost
    if (i == 20) continue;                                       // late: comes after 23
    text += packet(5000 + 4 * i, 1000 + i);
    if (i == 15) text += packet(5000 + 4 * i, 1000 + i);         // repeated
    if (i == 23) text += packet(5000 + 4 * 20, 1000 + 20);
  }
  const auto log = read_robot_log(text, "rsi.xml", "");
  ASSERT_TRUE(log) << log.error()[0].message;
  EXPECT_EQ(log->samples.size(), 37u);
  EXPECT_EQ(log->repeated_count, 1u);
  EXPECT_EQ(log->late_count, 1u);
  EXPECT_TRUE(log->resets.empty());
  EXPECT_NEAR(log->cycle_s, 0.004, 1e-12);
  for (const RobotLogSample& s : log->samples) {
    EXPECT_NEAR(s.T_base_tool.p_mm.x(), 1000 + (s.t_s - 5) / 0.004, 1e-6);
    EXPECT_NEAR(s.T_base_tool.q.angularDistance(quat_from_zyx(rad_from_deg(10), rad_from_deg(20), rad_from_deg(30))), 0, 1e-7);
  }
}

TEST(RobotLog, nul_bytes_decimal_commas_and_a_cut_end_do_not_matter) {
  std::string text = packet(4, 1);
  text.insert(20, 1, '\0');
  std::string comma = packet(8, 2.25);
  for (char& c : comma)
    if (c == '.') c = ',';
  text += comma + packet(12, 3).substr(0, 60);
  const auto log = read_robot_log(text, "rsi.xml", "");
  ASSERT_TRUE(log) << log.error()[0].message;
  ASSERT_EQ(log->samples.size(), 2u);
  EXPECT_EQ(log->nul_count, 1u);
  EXPECT_EQ(log->broken_count, 1u);
  EXPECT_NEAR(log->samples[1].T_base_tool.p_mm.x(), 2.25, 1e-9);
  const auto table = read_robot_log("t_s;x;y;z;a;b;c\n0,0;1,5;2;3;0;0;0\n0,01;1,75;2;3;0;0;0\n0,02;1,", "p.csv", "");
  ASSERT_TRUE(table) << table.error()[0].message;
  ASSERT_EQ(table->samples.size(), 2u);
  EXPECT_NEAR(table->samples[1].T_base_tool.p_mm.x(), 1.75, 1e-12);
}

TEST(RobotLog, a_counter_that_wraps_runs_on_and_one_that_is_reset_is_said) {
  std::string wraps, resets;
  for (long i = 0; i < 10; ++i) wraps += packet((4294967296l - 20 + 4 * i) % 4294967296l, static_cast<double>(i));
  for (long i = 0; i < 10; ++i) resets += packet(i < 5 ? 100000 + 4 * i : 4 * i, static_cast<double>(i));
  const auto w = read_robot_log(wraps, "rsi.xml", ""), r = read_robot_log(resets, "rsi.xml", "");
  ASSERT_TRUE(w && r);
  EXPECT_EQ(w->wrap_count, 1u);
  EXPECT_TRUE(w->resets.empty());
  ASSERT_EQ(r->resets.size(), 1u);
  EXPECT_NEAR(r->resets[0].jump_s, 99.996, 1e-9);
  for (const auto* log : {&*w, &*r})
    for (std::size_t i = 1; i < log->samples.size(); ++i) EXPECT_NEAR(log->samples[i].t_s - log->samples[i - 1].t_s, 0.004, 1e-9);
}

TEST(RobotLog, the_flash_is_a_tag_an_attribute_or_a_column) {
  std::string text;
  for (long i = 0; i < 20; ++i) text += packet(4 * i, 0, i >= 7 ? "<FLASH>1</FLASH><Digin o1=\"0\"/>" : "<FLASH>0</FLASH><Digin o1=\"1\"/>");
  const auto log = read_robot_log(text, "rsi.xml", "FLASH");
  ASSERT_TRUE(log);
  ASSERT_EQ(log->flash_s.size(), 1u);
  EXPECT_NEAR(log->flash_s[0][0], 0.024, 1e-12);
  EXPECT_NEAR(log->flash_s[0][1], 0.028, 1e-12);
  EXPECT_TRUE(read_robot_log(text, "rsi.xml", "Digin.o1"));
  EXPECT_EQ(code_of(read_robot_log(text, "rsi.xml", "LAMP")), "input.log_channel");
  const auto table = read_robot_log("ipoc,x_m,y_m,z_m,qw,qx,qy,qz,Flash\n0,1,0,0,1,0,0,0,0\n4,1.5,0,0,1,0,0,0,1\n", "p.csv", "FLASH");
  ASSERT_TRUE(table);
  EXPECT_EQ(table->flash_s.size(), 1u);
  EXPECT_NEAR(table->samples[1].T_base_tool.p_mm.x(), 1500, 1e-9);
  EXPECT_EQ(code_of(read_robot_log("t,x,y,z,a,b,c\n0,0,0,0,0,0,0\n1,0,0,0,0,0,0\n", "p.csv", "FLASH")), "input.log_channel");
}

TEST(RobotLogRefuses, what_is_no_log) {
  EXPECT_EQ(code_of(read_robot_log("<ROOT><CONFIG/></ROOT>", "rsi.xml", "")), "input.log_format");
  EXPECT_EQ(code_of(read_robot_log("", "rsi.xml", "")), "input.table_empty");
  EXPECT_EQ(code_of(read_robot_log("1,2,3\n4,5,6\n", "p.csv", "")), "input.table_header");
  EXPECT_EQ(code_of(read_robot_log("t,t,x\n4,5,6\n", "p.csv", "")), "input.table_header");
  EXPECT_EQ(code_of(read_robot_log("t,x,y,z,a,b,c\n", "p.csv", "")), "input.table_empty");
  EXPECT_EQ(code_of(read_robot_log("t,x,y,z,a,b,c\n0,1,abc,0,0,0,0\n1,0,0,0,0,0,0\n", "p.csv", "")), "input.table_value");
  EXPECT_EQ(code_of(read_robot_log("t,x,y,z,a,b,c\n0,1,,0,0,0,0\n1,0,0,0,0,0,0\n", "p.csv", "")), "input.log_value");
  EXPECT_EQ(code_of(read_robot_log("x,y,z,a,b,c\n1,0,0,0,0,0\n", "p.csv", "")), "input.log_columns");
  EXPECT_EQ(code_of(read_robot_log("t,ref_pos_deg_a1\n1,0\n2,0\n", "p.csv", "")), "input.log_columns");
  EXPECT_EQ(code_of(read_robot_log("<Rob><RSol X=\"1\"/><IPOC>4</IPOC></Rob><Rob><IPOC>8</IPOC></Rob>", "rsi.xml", "")), "input.log_columns");
  EXPECT_EQ(code_of(read_robot_log("t,x,y,z,a,b,c\n0,1,1,0,0,0,0\n", "p.csv", "")), "input.log_empty");
  EXPECT_EQ(code_of(read_robot_log("t,x,y,z,a,b,c\n5,1,1,0,0,0,0\n5,1,1,0,0,0,0\n", "p.csv", "")), "input.log_clock");
  EXPECT_EQ(code_of(read_robot_log("t,x,y,z,a,b,c\nnan,1,1,0,0,0,0\n5,1,1,0,0,0,0\n", "p.csv", "")), "input.log_clock");
  std::string broken;
  for (long i = 0; i < 20; ++i) broken += i % 3 == 0 ? "<Rob><RIst X=\"a\"/></Rob>" : packet(4 * i, 0);
  EXPECT_EQ(code_of(read_robot_log(broken, "rsi.xml", "")), "input.log_value");
}

std::string joint_table(double unit, bool has_sixth) {
  std::string text = "t_s";
  for (const char* name : {"act_pos_motor_deg_a", "act_pos_secondary_encoder_deg_a", "act_vel_motor_deg_s_a"})
    for (int j = 1; j <= 6; ++j) text += "," + std::string(name) + std::to_string(j);
  for (int i = 0; i < 200; ++i) {
    const double t = 0.004 * i;
    text += "\n" + std::to_string(t * unit);
    for (int k = 0; k < 3; ++k)
      for (int j = 1; j <= 6; ++j) {
        const double value = k == 2 ? 20 * std::cos(2 * t) : 10 * std::sin(2 * t) + (k == 1 ? 0.03 * std::sin(40 * t) : 0);
        text += "," + ((k == 1 && j > 3) || (j == 6 && !has_sixth) ? "0" : std::to_string(value));
      }
  }
  return text + "\n";
}

TEST(RobotLog, columns_of_zeros_are_no_encoders_and_speeds_check_the_time_base) {
  const auto log = read_robot_log(joint_table(1, true), "j.csv", "");
  ASSERT_TRUE(log) << log.error()[0].message;
  EXPECT_FALSE(log->has_poses);
  EXPECT_TRUE(log->has_joints && log->has_joint[5] && log->has_secondary[2]);
  EXPECT_FALSE(log->has_secondary[3]);
  EXPECT_EQ(log->absent_columns.size(), 3u);
  EXPECT_NEAR(log->secondary_sd_deg[0], 0.03 / std::sqrt(2.0), 0.002);
  EXPECT_NEAR(log->speed_slope_ratio[0], 1, 0.01);
  EXPECT_FALSE(read_robot_log(joint_table(1, false), "j.csv", "")->has_joint[5]);
  const auto wrong = read_robot_log(joint_table(1.25, true), "j.csv", "");
  EXPECT_EQ(code_of(wrong), "input.log_time_base");
  EXPECT_NEAR(wrong.error()[0].measured, 0.8, 0.01);
}

TEST(RobotLog, the_real_logs_of_a_large_arm_read_as_the_published_facts_say) {
  for (const char* name : {"kr300_A.csv", "kr300_B.csv"}) {
    const std::filesystem::path file = std::filesystem::path("../shared/data/logs/kuka_kr300_250hz") / name;
    if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there";
    const auto log = read_robot_log(*read_file(file, name), name, "");
    ASSERT_TRUE(log) << log.error()[0].message;
    EXPECT_EQ(log->samples.size(), 2501u);
    EXPECT_NEAR(log->cycle_s, 0.004, 1e-9);
    EXPECT_EQ(log->late_count + log->repeated_count + log->resets.size(), 0u);
    for (std::size_t j = 0; j < 6; ++j) {
      EXPECT_TRUE(log->has_joint[j]);
      EXPECT_EQ(log->has_secondary[j], j < 3);
      if (j < 3) {
        EXPECT_GT(log->secondary_sd_deg[j], 0.025);
        EXPECT_LT(log->secondary_sd_deg[j], 0.045);
      }
      EXPECT_LT(log->speed_rms_deg_s[j], 0.25);
    }
  }
}

TEST(DepthImage, goes_through_png_and_back) {
  DepthImage image{5, 3, {0, 1, 2, 3, 65535, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14}};
  const std::string bytes = write_depth_png(image);
  const auto back = read_depth_image(bytes, "d.png");
  ASSERT_TRUE(back);
  EXPECT_EQ(back->depth_count, image.depth_count);
  EXPECT_EQ(read_depth_image("no image at all, only a text that is long enough", "d.png").error()[0].code, "input.depth_format");
  EXPECT_EQ(read_depth_image(bytes.substr(0, bytes.size() - 20), "d.png").error()[0].code, "input.depth_broken");
  std::string eight = bytes, huge = bytes;
  eight[24] = 8;
  EXPECT_EQ(read_depth_image(eight, "d.png").error()[0].code, "input.depth_format");
  huge[16] = huge[20] = 0x7f;
  EXPECT_EQ(read_depth_header(huge, "d.png").error()[0].code, "input.depth_size");
}

TEST(StreamFiles, camera_frames_and_profiles) {
  const auto camera = read_camera_file(R"({"fx": 600, "fy": 601, "ppx": 320, "cy": 240, "depth_scale": 0.0001, "fps": 30, "plane": [0, 0, 2, 400]})", "c.json");
  ASSERT_TRUE(camera) << camera.error()[0].message;
  EXPECT_DOUBLE_EQ(camera->camera.depth_unit_mm, 0.1);
  EXPECT_DOUBLE_EQ((*camera->plane)[3], 200);
  EXPECT_EQ(read_camera_file("{", "c.json").error()[0].code, "input.camera_syntax");
  EXPECT_EQ(read_camera_file(R"({"fx": 600})", "c.json").error()[0].code, "input.camera_value");
  EXPECT_EQ(read_camera_file(R"({"fx": "a", "fy": 1, "cx": 1, "cy": 1})", "c.json").error()[0].code, "input.camera_value");
  const auto frames = read_frame_times("file,t_ms,exposure_ms,brightness\na.png,10,5,20\nb.png,43,5,250\n", "frames.csv");
  ASSERT_TRUE(frames);
  EXPECT_NEAR((*frames)[1].t_s, 0.043, 1e-12);
  EXPECT_NEAR((*frames)[1].brightness_ratio, 250 / 255.0, 1e-12);
  EXPECT_EQ(read_frame_times("name,t\n3,1\n", "frames.csv").error()[0].code, "input.frames_columns");
  EXPECT_EQ(read_frame_times("file,t\na,1\nb,1\n", "frames.csv").error()[0].code, "input.frames_clock");
  const auto profiles = read_profiles("t,x,z\n0,-1,100\n0,0,101\n0,1,\n0.01,0,102\n", "s.csv", std::nullopt);
  ASSERT_TRUE(profiles);
  EXPECT_EQ(profiles->lines.size(), 2u);
  EXPECT_EQ(profiles->points.size(), 3u);
  EXPECT_EQ(profiles->dropped_count, 1u);
  const auto pixels = read_profiles("t,u,v\n0,320,240\n0,620,240\n", "s.csv", *camera);
  ASSERT_TRUE(pixels);
  EXPECT_NEAR(pixels->points[1].x(), 100, 1e-4);
  EXPECT_NEAR(pixels->points[1].z(), 200, 1e-4);
  EXPECT_EQ(read_profiles("t,u,v\n0,320,240\n", "s.csv", std::nullopt).error()[0].code, "input.profile_camera");
  EXPECT_EQ(read_profiles("t,q\n0,320\n", "s.csv", std::nullopt).error()[0].code, "input.profile_columns");
  EXPECT_EQ(read_profiles("t,x,z\n1,0,5\n0,0,5\n", "s.csv", std::nullopt).error()[0].code, "input.profile_clock");
  EXPECT_EQ(read_profiles("t,x,z\n1,,\n", "s.csv", std::nullopt).error()[0].code, "input.profile_empty");
}

TEST(StreamFiles, any_bytes_give_a_result_or_a_refusal_with_a_place) {
  Random random(77);
  const std::string seeds[] = {packet(4, 1) + packet(8, 2) + packet(12, 3), joint_table(1, true).substr(0, 3000), "t_s;x;y;z;a;b;c\n0,0;1,5;2;3;0;0;0\n0,01;1,75;2;3;0;0;0\n",
                               "file,t_ms,exposure_ms,brightness\na.png,10,5,20\nb.png,43,5,250\n", R"({"fx": 600, "fy": 601, "ppx": 320, "cy": 240, "plane": [0, 0, 2, 400]})",
                               write_depth_png({5, 3, std::vector<std::uint16_t>(15, 7)})};
  for (int round = 0; round < 3000; ++round) {
    std::string text = seeds[random.below(std::size(seeds))];
    for (int k = 0, n = 1 + static_cast<int>(random.below(6)); k < n && !text.empty(); ++k) {
      const std::size_t at = random.below(text.size());
      switch (random.below(5)) {
        case 0: text[at] = static_cast<char>(random.below(256)); break;
        case 1: text.erase(at, 1 + random.below(20)); break;
        case 2: text.insert(at, text.substr(random.below(text.size()), random.below(40))); break;
        case 3: text.resize(at); break;
        default: text.insert(at, "<Rob,;\"-1e999nan"); break;
      }
    }
    const auto check = [](const auto& r) {
      if (r) return;
      EXPECT_FALSE(r.error().empty());
      for (const Refusal& e : r.error()) EXPECT_TRUE(e.code.starts_with("input.") && e.where.starts_with("f.") && !e.message.empty()) << e.code << " " << e.where;
    };
    check(read_robot_log(text, "f.xml", round % 2 ? "FLASH" : "")), check(read_frame_times(text, "f.csv")), check(read_profiles(text, "f.csv", std::nullopt));
    check(read_camera_file(text, "f.json")), check(read_depth_image(text, "f.png"));
  }
}

}  // namespace
}  // namespace asbuilt
