// Prints the camera velocities of ViSP's own servo laws on the scene of its tutorial-ibvs-4pts, with all digits.
//
// One line for every iteration: the run's name, the number of the iteration, and the six numbers of the velocity
// (linear [m/s], angular [rad/s], camera frame) that vpServo::computeControlLaw gives. First line: ViSP's version.
//
//     g++ -O2 -I/usr/include/opencv4 -o velocities velocities.cpp -lvisp_vs -lvisp_visual_features -lvisp_robot -lvisp_core
//     ./velocities > ../../../tests/servoing/visp_velocities.txt

#include <cmath>
#include <cstdio>
#include <string>
#include <visp3/core/vpConfig.h>
#include <visp3/robot/vpSimulatorCamera.h>
#include <visp3/visual_features/vpFeatureDepth.h>
#include <visp3/visual_features/vpFeaturePoint.h>
#include <visp3/visual_features/vpFeatureThetaU.h>
#include <visp3/visual_features/vpFeatureTranslation.h>
#include <visp3/vs/vpServo.h>

namespace {

const int ITERATIONS = 150;
const double PERIOD = 0.040;
const vpHomogeneousMatrix cdMo(0, 0, 0.75, 0, 0, 0);
const vpHomogeneousMatrix FIRST(0.15, -0.1, 1., vpMath::rad(10), vpMath::rad(-10), vpMath::rad(50));

vpPoint corner(int i) {
  static const double PLACES[4][2] = {{-0.1, -0.1}, {0.1, -0.1}, {0.1, 0.1}, {-0.1, 0.1}};
  return vpPoint(PLACES[i][0], PLACES[i][1], 0);
}

void see_point(vpFeaturePoint &s, vpPoint point, const vpHomogeneousMatrix &cMo) {
  point.track(cMo);
  s.buildFrom(point.get_x(), point.get_y(), point.get_Z());
}

struct Task {
  vpServo servo;
  virtual void see(const vpHomogeneousMatrix &cMo) = 0;
  virtual ~Task() { servo.kill(); }
};

struct ImagePoints : Task {
  vpFeaturePoint s[4], wanted[4];
  explicit ImagePoints(vpServo::vpServoIteractionMatrixType matrix) {
    servo.setServo(vpServo::EYEINHAND_CAMERA);
    servo.setInteractionMatrixType(matrix);
    for (int i = 0; i < 4; i++) {
      see_point(wanted[i], corner(i), cdMo);
      see_point(s[i], corner(i), FIRST);
      servo.addFeature(s[i], wanted[i]);
    }
  }
  void see(const vpHomogeneousMatrix &cMo) override {
    for (int i = 0; i < 4; i++) see_point(s[i], corner(i), cMo);
  }
};

struct Pose : Task {
  bool camera;  // whose translation: the camera's, or the target's
  vpFeatureTranslation t, wanted;
  vpFeatureThetaU turn;
  explicit Pose(bool camera_)
    : camera(camera_), t(camera_ ? vpFeatureTranslation::cdMc : vpFeatureTranslation::cMo),
      wanted(camera_ ? vpFeatureTranslation::cdMc : vpFeatureTranslation::cMo), turn(vpFeatureThetaU::cdRc) {
    servo.setServo(vpServo::EYEINHAND_CAMERA);
    servo.setInteractionMatrixType(vpServo::CURRENT);
    wanted.buildFrom(camera ? vpHomogeneousMatrix() : cdMo);
    see(FIRST);
    servo.addFeature(t, wanted);
    servo.addFeature(turn);
  }
  void see(const vpHomogeneousMatrix &cMo) override {
    const vpHomogeneousMatrix cdMc = cdMo * cMo.inverse();
    t.buildFrom(camera ? cdMc : cMo);
    turn.buildFrom(cdMc);
  }
};

struct Hybrid : Task {
  vpFeaturePoint s, wanted;
  vpFeatureDepth depth, same;
  vpFeatureThetaU turn;
  double Zd;
  Hybrid() : turn(vpFeatureThetaU::cdRc) {
    servo.setServo(vpServo::EYEINHAND_CAMERA);
    servo.setInteractionMatrixType(vpServo::CURRENT);
    see_point(wanted, corner(0), cdMo);
    Zd = wanted.get_Z();
    same.buildFrom(wanted.get_x(), wanted.get_y(), Zd, 0);
    see(FIRST);
    servo.addFeature(s, wanted);
    servo.addFeature(depth, same);
    servo.addFeature(turn);
  }
  void see(const vpHomogeneousMatrix &cMo) override {
    see_point(s, corner(0), cMo);
    depth.buildFrom(s.get_x(), s.get_y(), s.get_Z(), log(s.get_Z() / Zd));
    turn.buildFrom(cdMo * cMo.inverse());
  }
};

void run(const std::string &name, Task &task) {
  vpSimulatorCamera robot;
  robot.setSamplingTime(PERIOD);
  vpHomogeneousMatrix wMc;
  robot.getPosition(wMc);
  const vpHomogeneousMatrix wMo = wMc * FIRST;
  for (int k = 0; k < ITERATIONS; k++) {
    robot.getPosition(wMc);
    task.see(wMc.inverse() * wMo);
    const vpColVector v = task.servo.computeControlLaw();
    printf("%s %d", name.c_str(), k);
    for (int j = 0; j < 6; j++) printf(" %.17g", v[j]);
    printf("\n");
    robot.setVelocity(vpRobot::CAMERA_FRAME, v);
  }
}

template <class Kind, class... Arguments> void both_gains(const std::string &name, Arguments... arguments) {
  Kind constant(arguments...), adaptive(arguments...);
  constant.servo.setLambda(0.5);
  adaptive.servo.setLambda(vpAdaptiveGain(4, 0.4, 30));
  run(name + "/constant", constant);
  run(name + "/adaptive", adaptive);
}

}  // namespace

int main() {
  printf("# ViSP %d.%d.%d\n", VISP_VERSION_MAJOR, VISP_VERSION_MINOR, VISP_VERSION_PATCH);
  both_gains<ImagePoints>("ibvs", vpServo::CURRENT);
  both_gains<ImagePoints>("ibvs-desired", vpServo::DESIRED);
  both_gains<ImagePoints>("ibvs-mean", vpServo::MEAN);
  both_gains<Pose>("pbvs", true);
  both_gains<Pose>("pbvs-target", false);
  both_gains<Hybrid>("hybrid-2.5d");
}
