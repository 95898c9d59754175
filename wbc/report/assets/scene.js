// The robot of a run in space, at the time of the page's clock.
"use strict";
window.scenes = ({ data, followers, clock, go }) => {
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const floats = (text) => new Float32Array(bytes(text));
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const V = (a, k) => new THREE.Vector3(a[k], a[k + 1], a[k + 2]);

  function arrow(material, size) {
    const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.008 * size, 0.008 * size, 1, 10), material);
    const tip = new THREE.Mesh(new THREE.ConeGeometry(0.022 * size, 0.05 * size, 14), material);
    const whole = new THREE.Group();
    whole.add(shaft, tip);
    const up = new THREE.Vector3(0, 1, 0), way = new THREE.Vector3();
    whole.set = (tail, end) => {
      way.subVectors(end, tail);
      const length = way.length();
      whole.visible = length > 1e-4;
      if (!whole.visible) return;
      whole.position.copy(tail);
      whole.quaternion.setFromUnitVectors(up, way.divideScalar(length));
      const head = Math.min(0.05 * size, 0.6 * length);
      shaft.scale.y = length - head;
      shaft.position.y = 0.5 * (length - head);
      tip.scale.setScalar(head / (0.05 * size));
      tip.position.y = length - 0.5 * head;
    };
    return whole;
  }

  // A grid of lines that are cut at every crossing: some renderers drop a whole line that passes behind the camera.
  function grid(size, cells, ...colours) {
    const whole = new THREE.GridHelper(size, cells, ...colours);
    for (const name of ["position", "color"]) {
      const { array } = whole.geometry.getAttribute(name), cut = new Float32Array(cells * array.length);
      for (let line = 0; line < array.length; line += 6) {
        for (let end = 0; end < 2 * cells; end++) {
          const s = Math.ceil(end / 2) / cells;
          for (let k = 0; k < 3; k++) cut[cells * line + 3 * end + k] = (1 - s) * array[line + k] + s * array[line + 3 + k];
        }
      }
      whole.geometry.setAttribute(name, new THREE.BufferAttribute(cut, 3));
    }
    return whole;
  }

  function build(box) {
    const first = data.scenes[box.dataset.scene], size = first.size;
    const middle = new THREE.Vector3(...first.middle);
    const scene = new THREE.Scene();
    let renderer;
    try {
      renderer = new THREE.WebGLRenderer({ antialias: true });
    } catch {
      box.textContent = "This browser draws no 3-D (WebGL); the moments below show the motion.";
      return;
    }
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    box.append(renderer.domElement);
    const camera = new THREE.PerspectiveCamera(43, 1, 0.01 * size, 60 * size);
    camera.up.set(0, 0, 1);
    camera.position.copy(middle).addScaledVector(new THREE.Vector3(...first.view), size);
    const controls = new THREE.OrbitControls(camera, renderer.domElement);
    controls.target.copy(middle);
    scene.add(new THREE.HemisphereLight(0xffffff, 0x8a8f98, 2.0));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(2, -3, 6);
    scene.add(sun);
    let floor = null;
    const paint = () => {
      scene.background = new THREE.Color(dark.matches ? 0x171c22 : 0xffffff);
      if (floor) scene.remove(floor);
      floor = grid(8, 32, dark.matches ? 0x4a545f : 0xb9c1c9, dark.matches ? 0x2b333b : 0xdfe3e7);
      floor.rotation.x = Math.PI / 2;
      floor.position.set(Math.round(middle.x), Math.round(middle.y), 0);
      scene.add(floor);
    };

    // ---- a layer is the motion of one run: the robot of the page, and those that it is compared with, seen through
    function layer(spec, ghost) {
      const times = floats(spec.times), count = times.length;
      const solid = (color, more = {}) => new THREE.MeshLambertMaterial({ color, ...more, ...(ghost ? { transparent: true, opacity: 0.4, depthWrite: false, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 4 } : {}) });
      const root = new THREE.Group();
      scene.add(root);
      const links = spec.links.map((link) => {
        const node = new THREE.Group();
        root.add(node);
        return { node, pose: floats(link.pose), strained: link.strained };
      });
      const meshes = (spec.parts ?? first.parts).map((part) => {
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", new THREE.BufferAttribute(floats(part.vertices), 3));
        geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(part.faces)), 1));
        const material = solid(ghost ? spec.color : part.color, { flatShading: true, side: THREE.DoubleSide });
        const mesh = new THREE.Mesh(geometry, material);
        links[part.link].node.add(mesh);
        return { mesh, link: links[part.link], colour: material.color.clone() };
      });
      const arrows = spec.arrows.map((set) => {
        const ends = floats(set.ends), drawn = Array.from({ length: set.count }, () => arrow(solid(set.color), size));
        for (const one of drawn) scene.add(one);
        return { set, ends, drawn };
      });
      const points = spec.points.map((point) => {
        const path = floats(point.path);
        const ball = new THREE.Mesh(new THREE.SphereGeometry(0.018 * size, 16, 12), solid(point.color, { depthTest: false, transparent: true }));
        ball.renderOrder = 2;  // seen through the robot
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", new THREE.BufferAttribute(path, 3));
        const trail = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: point.color, transparent: true, opacity: ghost ? 0.35 : 0.7 }));
        trail.frustumCulled = false;
        scene.add(ball, trail);
        return { point, path, ball, trail, geometry };
      });
      const loops = spec.loops.map((loop) => {
        const corners = floats(loop.corners), each = loop.count;
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * each), 3));
        const drawn = new THREE.LineLoop(geometry, new THREE.LineBasicMaterial({ color: loop.color, transparent: true, opacity: ghost ? 0.4 : 1 }));
        drawn.frustumCulled = false;
        scene.add(drawn);
        return { loop, corners, each, geometry, drawn };
      });
      const a = new THREE.Quaternion(), b = new THREE.Quaternion();
      const at = (t) => {
        root.visible = !spec.hidden;
        let k = Math.min(Math.max(Math.floor(((t - times[0]) / (times[count - 1] - times[0] || 1)) * (count - 1)), 0), count - 1);
        while (k > 0 && times[k] > t) k--;
        while (k < count - 2 && times[k + 1] <= t) k++;
        const n = Math.min(k + 1, count - 1), s = n > k ? Math.min(Math.max((t - times[k]) / (times[n] - times[k]), 0), 1) : 0;
        for (const { node, pose } of links) {
          const i = 7 * k, j = 7 * n;
          node.position.lerpVectors(V(pose, i), V(pose, j), s);
          a.set(pose[i + 4], pose[i + 5], pose[i + 6], pose[i + 3]);
          b.set(pose[j + 4], pose[j + 5], pose[j + 6], pose[j + 3]);
          node.quaternion.slerpQuaternions(a, b, s);
        }
        const near = s < 0.5 ? k : n;
        for (const { set, ends, drawn } of arrows) {
          drawn.forEach((one, m) => {
            const i = 6 * (near * set.count + m);
            one.set(V(ends, i), V(ends, i + 3));
            one.visible &&= !set.hidden && !spec.hidden;
          });
        }
        for (const { point, path, ball, trail, geometry } of points) {
          ball.position.lerpVectors(V(path, 3 * k), V(path, 3 * n), s);
          geometry.setDrawRange(0, k + 1);
          ball.visible = trail.visible = !point.hidden && !spec.hidden && isFinite(ball.position.x);
        }
        for (const { loop, corners, each, geometry, drawn } of loops) {
          geometry.attributes.position.array.set(corners.subarray(3 * each * near, 3 * each * (near + 1)));
          geometry.attributes.position.needsUpdate = true;
          drawn.visible = !loop.hidden && !spec.hidden;
        }
        for (const { mesh, link, colour } of meshes) {
          const strained = link.strained && link.strained.some(([from, to]) => t >= from && t <= to);
          mesh.material.color.copy(colour);
          if (strained) mesh.material.color.set(0xd23b3b);
        }
      };
      return { at, links };
    }

    const all = [first, ...first.ghosts], layers = all.map((one, k) => layer(one, k > 0));
    let wanted = true;
    function at(t) {
      for (const one of layers) one.at(t);
      wanted = true;
    }
    const key = box.parentElement.querySelector(".key");
    const named = new Map();
    for (const shown of [...(all.length > 1 ? all : []), ...all.flatMap((one) => [...one.arrows, ...one.points, ...one.loops])]) {
      const name = shown.group ?? shown.label;
      named.set(name, [...(named.get(name) ?? []), shown]);
    }
    for (const [name, same] of named) {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: name });
      button.style.setProperty("--dot", same[0].color);
      button.setAttribute("aria-pressed", String(!same[0].hidden));
      button.addEventListener("click", () => {
        for (const shown of same) shown.hidden = !shown.hidden;
        button.setAttribute("aria-pressed", String(!same[0].hidden));
        at(clock.t);
      });
      if (key) key.append(button);
    }
    const fit = () => {
      const { clientWidth: width, clientHeight: height } = box;
      if (!width || !height) return;
      renderer.setSize(width, height);
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
      wanted = true;
    };
    new ResizeObserver(fit).observe(box);
    dark.addEventListener("change", () => { paint(); wanted = true; });
    controls.addEventListener("change", () => { wanted = true; });
    followers.push(at);
    box.at = (k = 0) => layers[k].links.map(({ node }) => node.position.toArray());
    paint();
    controls.update();
    fit();
    const render = () => {
      if (wanted) { wanted = false; renderer.render(scene, camera); }
      requestAnimationFrame(render);
    };
    render();
  }
  for (const box of document.querySelectorAll("[data-scene]")) build(box);
};
