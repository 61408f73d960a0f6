"""One central Kalman filter over all targets and biases."""

from __future__ import annotations

import numpy as np

from gda_tracker.fusion.motion import transition, white_noise_covariance


class CentralFilter:
    """One Kalman filter over all targets and all biases, in covariance form, by blocks."""

    def __init__(self, n, bias_std_m, density):
        self.n, self.density = n, density
        self.size = 4 * n + 2 * len(bias_std_m)
        self.mean = np.zeros(self.size)
        self.covariance = np.diag(
            np.concatenate([np.full(4 * n, 1e16), np.repeat(np.square(bias_std_m), 2)])
        )

    def predict(self, dt_s):
        F, Q = np.eye(self.size), np.zeros((self.size, self.size))
        for k in range(self.n):
            rows = slice(4 * k, 4 * k + 4)
            F[rows, rows] = transition(np.array([dt_s]))[0]
            Q[rows, rows] = white_noise_covariance(np.array([dt_s]), self.density)[0]
        self.mean, self.covariance = F @ self.mean, F @ self.covariance @ F.T + Q

    def update(self, radar, targets, values, noise, measure):
        """Take in y = measure (x - b) + noise of some targets."""
        for k in targets:
            row = np.zeros((len(measure), self.size))
            row[:, 4 * k : 4 * k + 4] = measure
            first = 4 * self.n + 2 * radar
            row[:, first : first + 2] = -measure[:, :2]
            gain = self.covariance @ row.T
            gain = gain @ np.linalg.inv(row @ gain + noise)
            self.mean = self.mean + gain @ (values[k] - row @ self.mean)
            left = np.eye(self.size) - gain @ row
            self.covariance = left @ self.covariance @ left.T + gain @ noise @ gain.T

    def target(self, k):
        rows = slice(4 * k, 4 * k + 4)
        return self.mean[rows], self.covariance[rows, rows]

    def bias(self, radar):
        first = 4 * self.n + 2 * radar
        return self.mean[first : first + 2], self.covariance[first : first + 2, first : first + 2]
