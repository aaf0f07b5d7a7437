// OpenGV's answers to scenes read from the standard input, one line each method and scene:
// scene, method, microseconds (shortest of three), rotation row by row, translation.
//
// A scene: "relative THRESHOLD N", then N lines of two bearings; or "absolute THRESHOLD N", then N lines of a
// bearing and a point. THRESHOLD is an angle [rad]. The pose is that of the second camera in the first one's
// frame, or of the camera in the points' frame.
//
//   g++ -O2 -w -I/usr/include/eigen3 solve.cpp -o solve -lopengv

#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <iostream>
#include <limits>
#include <numeric>
#include <string>

#include <opengv/absolute_pose/CentralAbsoluteAdapter.hpp>
#include <opengv/absolute_pose/methods.hpp>
#include <opengv/relative_pose/CentralRelativeAdapter.hpp>
#include <opengv/relative_pose/methods.hpp>
#include <opengv/sac/Ransac.hpp>
#include <opengv/sac_problems/absolute_pose/AbsolutePoseSacProblem.hpp>
#include <opengv/sac_problems/relative_pose/CentralRelativePoseSacProblem.hpp>

using namespace opengv;
using Relative = sac_problems::relative_pose::CentralRelativePoseSacProblem;
using Absolute = sac_problems::absolute_pose::AbsolutePoseSacProblem;

namespace {

const int kMostSamples = 1000;
const int kRepeats = 3;

transformation_t none() {
    return transformation_t::Constant(std::numeric_limits<double>::quiet_NaN());
}

std::vector<int> all(size_t count) {
    std::vector<int> indices(count);
    std::iota(indices.begin(), indices.end(), 0);
    return indices;
}

void report(int scene, const std::string &method, const std::function<transformation_t()> &solve) {
    double least = std::numeric_limits<double>::infinity();
    transformation_t found;
    for (int k = 0; k < kRepeats; ++k) {
        const auto begin = std::chrono::steady_clock::now();
        found = solve();
        const std::chrono::duration<double, std::micro> taken = std::chrono::steady_clock::now() - begin;
        least = std::min(least, taken.count());
    }
    std::printf("%d %s %.3f", scene, method.c_str(), least);
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) std::printf(" %.17g", found(row, column));
    for (int row = 0; row < 3; ++row) std::printf(" %.17g", found(row, 3));
    std::printf("\n");
}

// The best of random samples, refined on what agrees with it: the problem's own nonlinear optimisation.
template <class Problem>
transformation_t ransac(std::shared_ptr<Problem> problem, double threshold) {
    sac::Ransac<Problem> search(kMostSamples, threshold, 0.9999);
    search.sac_model_ = problem;
    if (!search.computeModel(0)) return none();
    transformation_t refined;
    problem->optimizeModelCoefficients(search.inliers_, search.model_coefficients_, refined);
    return refined;
}

void relative(int scene, double angle, const bearingVectors_t &first, const bearingVectors_t &second) {
    relative_pose::CentralRelativeAdapter adapter(first, second);
    const double threshold = 2.0 * (1.0 - std::cos(angle));  // the sum over both cameras
    report(scene, "ransac", [&] {
        return ransac(std::make_shared<Relative>(adapter, Relative::NISTER, false), threshold);
    });
    report(scene, "eight-point", [&] {
        Relative problem(adapter, Relative::EIGHTPT, false);
        const std::vector<int> indices = all(first.size());
        transformation_t model, refined;
        if (!problem.computeModelCoefficients(indices, model)) return none();
        problem.optimizeModelCoefficients(indices, model, refined);
        return refined;
    });
}

// From a first pose, by OpenGV's nonlinear optimisation over all bearings.
transformation_t refined(const bearingVectors_t &bearings, const points_t &points,
                         const transformation_t &start) {
    absolute_pose::CentralAbsoluteAdapter adapter(bearings, points, start.col(3), start.leftCols<3>());
    return absolute_pose::optimize_nonlinear(adapter);
}

double cost(const bearingVectors_t &bearings, const points_t &points, const transformation_t &pose) {
    double sum = 0.0;
    for (size_t k = 0; k < points.size(); ++k) {
        const Eigen::Vector3d seen = pose.leftCols<3>().transpose() * (points[k] - pose.col(3));
        sum += 1.0 - seen.normalized().dot(bearings[k]);
    }
    return sum;
}

void absolute(int scene, double angle, const bearingVectors_t &bearings, const points_t &points) {
    absolute_pose::CentralAbsoluteAdapter adapter(bearings, points);
    report(scene, "ransac", [&] {
        return ransac(std::make_shared<Absolute>(adapter, Absolute::KNEIP, false), 1.0 - std::cos(angle));
    });
    report(scene, "epnp", [&] { return refined(bearings, points, absolute_pose::epnp(adapter)); });
    report(scene, "upnp", [&] {
        transformation_t best = none();
        double least = std::numeric_limits<double>::infinity();
        for (const transformation_t &pose : absolute_pose::upnp(adapter)) {
            const double sum = cost(bearings, points, pose);
            if (sum < least) least = sum, best = pose;
        }
        return std::isfinite(least) ? refined(bearings, points, best) : none();
    });
}

}  // namespace

int main() {
    std::string kind;
    double angle;
    size_t count;
    for (int scene = 0; std::cin >> kind >> angle >> count; ++scene) {
        bearingVectors_t first(count), second(count);
        for (size_t k = 0; k < count; ++k) {
            for (int i = 0; i < 3; ++i) std::cin >> first[k][i];
            for (int i = 0; i < 3; ++i) std::cin >> second[k][i];
        }
        if (!std::cin) return 1;
        if (kind == "relative") relative(scene, angle, first, second);
        else absolute(scene, angle, first, second);
    }
    return 0;
}
