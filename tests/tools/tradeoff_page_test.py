"""The page of `weft tradeoff` in a browser: a point is clicked and its pictures and figures found, the
table sorted and filtered, axes switched; nothing is asked of a network and nothing complains.

    python3 tradeoff_page_test.py WEFT
"""
import json
import math
import os
import subprocess
import sys
import tempfile
import unittest

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.select import Select
from selenium.webdriver.support.wait import WebDriverWait

WEFT = sys.argv.pop(1)
POINTS = ["pca --rank 1", "pca --rank 2", "pca --rank 4", "view-pca --rank 1", "view-pca --rank 2",
          "tucker --target rel=1e-6 --ranks v=2"]
MATERIALS = {"weave": "weave", "leather": "<img src=x onerror=fail()> & \"q\""}


def weft(*arguments):
    result = subprocess.run([WEFT, *arguments], capture_output=True, text=True)
    if result.returncode != 0:
        raise RuntimeError(f"weft {' '.join(arguments)}: {result.stderr}")


def make_page(folder):
    inputs = []
    for material, name in MATERIALS.items():
        inputs.append(os.path.join(folder, name + ".safetensors"))
        weft("synth", "--material", material, "--size", "16", "--view-set", "6", "--light-set", "5",
             "--samples", "1", "--quiet", "-o", inputs[-1])
    points = [word for point in POINTS for word in ("--point", point)]
    weft("tradeoff", *inputs, "-o", folder, "--repeat", "1", "--lookups", "1000", "--quiet", *points)
    with open(os.path.join(folder, "results.json"), encoding="utf-8") as file:
        return json.load(file)


def open_browser(profile):
    options = Options()
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
                     f"--user-data-dir={profile}", "--window-size=1280,1000"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    return webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))


class Page(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        cls.results = make_page(cls.folder.name)
        cls.browser = open_browser(os.path.join(cls.folder.name, "profile"))
        cls.browser.get("about:blank")
        cls.browser.get_log("performance")  # what the browser's own first page asked for
        cls.url = "file://" + os.path.join(cls.folder.name, "index.html")

    @classmethod
    def tearDownClass(cls):
        cls.browser.quit()
        cls.folder.cleanup()

    def setUp(self):
        self.browser.get(self.url)

    def find(self, selector):
        return self.browser.find_element(By.CSS_SELECTOR, selector)

    def all(self, selector):
        return self.browser.find_elements(By.CSS_SELECTOR, selector)

    def script(self, text, *arguments):
        return self.browser.execute_script("return " + text, *arguments)

    def points(self, **wanted):
        return [point for point in self.results["points"]
                if all(point[name] == value for name, value in wanted.items())]

    def rows(self):
        return [row.get_attribute("data-key") for row in self.all("#table tbody tr")]

    def wait_for_image(self, name):
        WebDriverWait(self.browser, 10).until(
            lambda _: self.script("document.getElementById(arguments[0])?.naturalWidth > 0", name),
            f"the image {name} was not drawn")

    def expect_figures(self, point):
        shown = {one.get_attribute("data-figure"): one.get_attribute("data-value")
                 for one in self.all("#detail [data-figure]")}
        self.assertEqual(self.find("#detail").get_attribute("data-key"), point["key"])
        for name in ("file_size", "ratio", "rmse", "psnr", "snr", "ssim", "encode_time", "image_rate",
                     "lookup_rate", "peak_memory"):
            self.assertEqual(float(shown[name]), point["figures"][name], name)
        self.assertEqual(self.find("#command").text, point["command"])

    def test_a_clicked_point_shows_its_figures_and_pictures(self):
        for material in MATERIALS.values():
            point = self.points(material=material, codec="pca")[1]
            mark = self.find(f'.mark[data-key="{point["key"]}"]')
            self.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", mark)
            mark.click()
            self.expect_figures(point)
            self.assertIn(material, self.find("#detail").text)
            for name in ("original", "decoded", "difference", "sphere", "sphere-original",
                         "sphere-difference"):
                self.wait_for_image(name)
            # the decoded images differ from the original's, and the difference is where they do
            self.assertNotEqual(*(self.find(name).get_attribute("src") for name in ("#original", "#decoded")))
            self.assertTrue(self.find("#difference").get_attribute("src").startswith("data:image/png"))
        once = self.find("#difference").get_attribute("src")
        Select(self.find("#factor")).select_by_value("16")
        WebDriverWait(self.browser, 10).until(
            lambda _: self.find("#difference").get_attribute("src") != once)

    def test_the_difference_is_that_of_the_pictures(self):
        self.find(f'#table tr[data-key="{self.points(codec="pca")[0]["key"]}"] button').click()
        for name in ("original", "decoded", "difference"):
            self.wait_for_image(name)
        worst = self.script("""(() => {
          const pixels = (id) => {
            const image = document.getElementById(id);
            const canvas = document.createElement('canvas');
            canvas.width = image.naturalWidth; canvas.height = image.naturalHeight;
            const context = canvas.getContext('2d');
            context.drawImage(image, 0, 0);
            return context.getImageData(0, 0, canvas.width, canvas.height).data;
          };
          const [a, b, d] = ['original', 'decoded', 'difference'].map(pixels);
          let worst = 0, sum = 0;
          for (let i = 0; i < a.length; ++i) {
            if (i % 4 === 3) continue;
            worst = Math.max(worst, Math.abs(Math.min(255, 4 * Math.abs(a[i] - b[i])) - d[i]));
            sum += d[i];
          }
          return [worst, sum];
        })()""")
        self.assertEqual(worst[0], 0)
        self.assertGreater(worst[1], 0)

    def test_the_table_sorts(self):
        done = [point for point in self.results["points"] if point["status"] == 0]
        for name, descending in (("psnr", True), ("encode_time", False)):
            self.find(f'[data-sort="{name}"]').click()
            expected = sorted((point["figures"][name] for point in done), reverse=descending)
            by_key = {point["key"]: point for point in self.results["points"]}
            rows = [by_key[key] for key in self.rows()]
            self.assertEqual([row["figures"].get(name) for row in rows], expected + [None] * 2)
            self.find(f'[data-sort="{name}"]').click()
            rows = [by_key[key] for key in self.rows()]
            self.assertEqual([row["figures"].get(name) for row in rows], expected[::-1] + [None] * 2)

    def test_filters(self):
        self.assertEqual(len(self.rows()), len(self.results["points"]))
        Select(self.find("#material")).select_by_value("weave")
        self.assertEqual(set(self.rows()), {p["key"] for p in self.points(material="weave")})
        self.assertEqual(len(self.all(".panel")), 1)
        self.find('#codecs [data-codec="pca"]').click()
        self.assertEqual(set(self.rows()), {p["key"] for p in self.points(material="weave")
                                            if p["codec"] != "pca"})
        self.find("#text").send_keys("rank 2")
        self.assertEqual(self.rows(), [p["key"] for p in self.points(material="weave", codec="view-pca")
                                       if p["options"] == ["--rank", "2"]])
        self.find("#reset").click()
        self.assertEqual(len(self.rows()), len(self.results["points"]))
        self.find("#ranges summary").click()
        bound = sorted(p["figures"]["psnr"] for p in self.points(status=0))[3]
        self.find('[data-range="psnr-from"]').send_keys(f"{math.floor(bound * 1000) / 1000}")
        self.assertEqual(set(self.rows()), {p["key"] for p in self.points(status=0)
                                            if p["figures"]["psnr"] >= math.floor(bound * 1000) / 1000})

    def test_axes(self):
        def places():
            return self.script("[...document.querySelectorAll('.mark')]"
                               ".map((m) => m.getAttribute('data-key') + m.getAttribute('transform')).sort()")

        before = places()
        for axis, name, figure in (("x", "Images/s", "image_rate"), ("y", "SSIM", "ssim")):
            Select(self.find(f"#{axis}-axis")).select_by_value(figure)
            self.assertIn(name, self.find(".axis").text)
            self.assertNotEqual(places(), before)
            before = places()
        self.find("#x-log").click()
        self.assertNotEqual(places(), before)
        self.assertEqual(len(places()), len(self.points(status=0)))
        # A better SSIM lies higher.
        marks = {m.get_attribute("data-key"): float(m.get_attribute("transform").split(",")[1][:-1])
                 for m in self.all(".panel[data-material='weave'] .mark")}
        points = sorted(self.points(material="weave", status=0), key=lambda p: p["figures"]["ssim"])
        heights = [marks[point["key"]] for point in points]
        self.assertEqual(heights, sorted(heights, reverse=True))

    def test_a_goal_that_is_not_met_says_why(self):
        point = self.points(status=1)[0]
        row = self.find(f'#table tr[data-key="{point["key"]}"]')
        self.assertIn("not met", row.text)
        row.find_element(By.TAG_NAME, "button").click()
        self.assertIn(point["message"], self.find("#detail").text)
        self.assertIn("2 with goals that are not met", self.find("#count").text)

    def test_the_keyboard_reaches_points(self):
        stop = self.find('.panel[data-material="weave"] .mark[tabindex="0"]')
        self.browser.execute_script("arguments[0].focus()", stop)
        self.browser.switch_to.active_element.send_keys(Keys.ARROW_RIGHT)
        key = self.script("document.activeElement.getAttribute('data-key')")
        self.assertNotEqual(key, stop.get_attribute("data-key"))
        self.browser.switch_to.active_element.send_keys(Keys.ENTER)
        self.assertEqual(self.find("#detail").get_attribute("data-key"), key)

    def test_widths_and_themes(self):
        for width in (1280, 800):
            self.browser.set_window_size(width, 1000)
            self.assertLessEqual(self.script("document.documentElement.scrollWidth"),
                                 self.script("window.innerWidth"))
        self.browser.set_window_size(1280, 1000)
        light = self.script("getComputedStyle(document.body).backgroundColor")
        self.find("#theme").click()
        self.assertNotEqual(self.script("getComputedStyle(document.body).backgroundColor"), light)

    def test_z_no_error_and_no_request(self):
        """Last by name: over all that the others have done."""
        self.assertEqual(self.browser.get_log("browser"), [])
        requested = set()
        for entry in self.browser.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                requested.add(message["params"]["request"]["url"].split(":")[0])
        self.assertLessEqual(requested, {"file", "data"})
        self.assertIn("file", requested)


if __name__ == "__main__":
    unittest.main()
