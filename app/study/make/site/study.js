// The page for participants. It needs no server: everything it shows comes from study-data.js and
// media/, and what it is told stays in this browser until the participant sends or saves it.
"use strict";

(function () {
  const study = window.STUDY;
  const words = study.words;
  const main = document.getElementById("main");

  // ---------------------------------------------------------------- small helpers

  function fill(text, values) {
    return text.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? values[name] : whole));
  }

  /** An element with properties, and children that are elements or texts. */
  function make(tag, properties, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(properties || {})) {
      if (name === "data") Object.assign(element.dataset, value);
      else if (name.includes("-") || name === "role" || name === "for") element.setAttribute(name, value);
      else element[name] = value;
    }
    element.append(...children.filter((child) => child !== null));
    return element;
  }

  function randomHex(bytes) {
    const values = crypto.getRandomValues(new Uint8Array(bytes));
    return Array.from(values, (value) => value.toString(16).padStart(2, "0")).join("");
  }

  function randomBelow(limit) {
    return crypto.getRandomValues(new Uint32Array(1))[0] % limit;
  }

  function problem(text) {
    return make("p", { className: "problem", role: "alert" }, text);
  }

  // ---------------------------------------------------------------- what is kept in the browser

  const query = new URLSearchParams(location.search);
  const isPreview = query.has("preview"); // by the researcher, who is no participant
  const postTo = isPreview ? null : study.postTo;

  const store = {
    works: true,
    get(key) {
      if (isPreview) return null;
      try {
        return localStorage.getItem(key);
      } catch {
        this.works = false;
        return null;
      }
    },
    set(key, value) {
      if (isPreview) return;
      try {
        localStorage.setItem(key, value);
      } catch {
        this.works = false;
      }
    },
  };

  const asked = query.get("p");
  const token = /^\d{1,6}-[0-9a-f]{32}$/.test(query.get("t") || "") ? query.get("t") : null; // a signed link
  const whoKey = `study/${study.study}/who/${asked === null ? "" : asked}${token ? `/${token}` : ""}`;

  const stateKey = (participant) => `study/${study.study}/${participant}`;
  const writerKey = (participant) => `${stateKey(participant)}/writer`;
  const writer = randomHex(8); // this tab; the one that was opened last writes

  function newState(participant = randomHex(8)) {
    store.set(whoKey, participant);
    return {
      participant,
      list: asked === null ? randomBelow(study.lists.length) : Number(asked),
      started: new Date().toISOString(),
      finished: null,
      headphones: "skipped",
      screen: "consent",
      answers: [],
      page: 0,
      draft: null,
      unsent: false,
      sent: false,
      saved: false,
    };
  }

  function loadState() {
    const participant = store.get(whoKey);
    const kept = /^[0-9a-f]{16}$/.test(participant || "") ? store.get(stateKey(participant)) : null;
    if (kept === null) return newState();
    const found = parsed(kept);
    if (isWhole(found)) return found;
    store.set(`${stateKey(participant)}/damaged`, kept); // a researcher may still read it
    return repaired(found, participant);
  }

  function parsed(text) {
    try {
      return JSON.parse(text);
    } catch {
      return null;
    }
  }

  const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
  const isList = (list) => Number.isInteger(list) && list >= 0 && list < study.lists.length;

  function isAnswerOf(list, answer) {
    return isObject(answer) && typeof answer.question === "string" && Array.isArray(answer.shown)
      && "value" in answer && study.lists[list].some(([id]) => id === answer.trial);
  }

  function isWhole(found) {
    if (!isObject(found) || typeof found.participant !== "string" || !isList(found.list)) return false;
    const { answers, draft, page, screen } = found;
    const last = study.lists[found.list].length;
    const isDraft = draft === null || (isObject(draft) && isObject(draft.watched)
      && isObject(draft.values) && Array.isArray(draft.reasons) && Number.isFinite(draft.ms));
    return isDraft && typeof found.started === "string"
      && Array.isArray(answers) && answers.every((answer) => isAnswerOf(found.list, answer))
      && Number.isInteger(page) && page >= 0 && page <= last
      && ["consent", "sound", "practice", "trial", "finish"].includes(screen) && (screen !== "trial" || page < last);
  }

  /** A state with whatever answers a damaged one still has. */
  function repaired(found, participant) {
    const whole = newState(participant);
    whole.repaired = true;
    if (!isObject(found)) return whole;
    if (asked === null && isList(found.list)) whole.list = found.list;
    for (const name of ["started", "headphones"]) {
      if (typeof found[name] === "string") whole[name] = found[name];
    }
    const answers = Array.isArray(found.answers) ? found.answers : [];
    return withAnswers(whole, answers.filter((answer) => isAnswerOf(whole.list, answer)));
  }

  /** The state with answers of another added, each question of a trial once, in the list's order. */
  function withAnswers(whole, others) {
    const name = (answer) => `${answer.trial} ${answer.question}`;
    const known = new Set(whole.answers.map(name));
    const added = others.filter((answer) => !known.has(name(answer)) && known.add(name(answer)));
    if (added.length === 0) return whole;
    const trials = study.lists[whole.list].map(([id]) => id);
    const place = (answer) => trials.indexOf(answer.trial);
    whole.answers = [...whole.answers, ...added].sort((one, other) => place(one) - place(other));
    const open = trials.findIndex((id) => !whole.answers.some((answer) => answer.trial === id));
    whole.page = open < 0 ? trials.length : open;
    whole.draft = null;
    whole.screen = open < 0 ? "finish" : "trial";
    if (open < 0) whole.finished = whole.finished || new Date().toISOString();
    return whole;
  }

  // One tab writes; what another one has written before is joined and never overwritten.

  // The browser's own lock says which, and the token decides where there is none (no HTTPS).

  let locks = isPreview ? null : navigator.locks || null;
  let turn = 0; // of this tab's requests for the lock
  let isLost = false;

  function isWriter() {
    if (isLost) return false;
    const held = store.get(writerKey(state.participant));
    return held === null || held === writer;
  }

  function takeOver() {
    const name = writerKey(state.participant);
    const mine = (turn += 1);
    const write = () => store.set(name, writer);
    isLost = false;
    write();
    if (!locks) return;
    locks.request(name, { steal: true }, () => {
      if (mine === turn) write(); // the last to get the lock is the last to say so
      return new Promise(() => {}); // until another tab takes it
    }).catch((error) => {
      if (error.name !== "AbortError") locks = null;
      else if (mine === turn) {
        isLost = true;
        stepBack();
      }
    });
  }

  function stepBack() {
    onKey = null;
    document.querySelectorAll("video").forEach((video) => video.pause());
    const here = button(words.buttons.here, () => {
      state = loadState();
      takeOver();
      save();
      render();
    }, { className: "main" });
    sheet(words.problems.elsewhere, make("div", { className: "actions" }, here));
  }

  function save() {
    if (!isWriter()) return false;
    if (state.draft && shownSince !== null) state.draft.ms = elapsed();
    const kept = parsed(store.get(stateKey(state.participant)));
    if (isWhole(kept) && kept.list === state.list) withAnswers(state, kept.answers);
    store.set(stateKey(state.participant), JSON.stringify(state));
    return true;
  }

  window.addEventListener("storage", (event) => {
    if (state && event.key === writerKey(state.participant) && !isWriter()) stepBack();
  });

  /** The file that the researcher gets. */
  function answersFile() {
    return {
      format: 1,
      study: study.study,
      participant: state.participant,
      list: state.list,
      started: state.started,
      finished: state.finished,
      device: {
        width: window.innerWidth,
        height: window.innerHeight,
        touch: navigator.maxTouchPoints > 0,
      },
      headphones: state.headphones,
      ...(token ? { link: token } : {}),
      answers: state.answers,
    };
  }

  // ---------------------------------------------------------------- screens

  let state = null;
  let onKey = null;
  let shownSince = null; // when the page of this draft appeared; null before

  function elapsed() {
    return Math.round(state.draft.before + performance.now() - shownSince);
  }

  function show(heading, ...children) {
    main.replaceChildren(...children.filter((child) => child !== null));
    window.scrollTo(0, 0);
    if (heading) {
      heading.tabIndex = -1; // read out by screen readers, and the place from where Tab goes on
      heading.focus({ preventScroll: true });
    }
  }

  function render() {
    onKey = null;
    const total = study.lists[state.list].length;
    const place = document.getElementById("place");
    const isTrial = state.screen === "trial";
    place.textContent = isTrial ? fill(words.progress.trial, { number: state.page + 1, total })
      : state.screen === "practice" ? words.practice.place : "";
    document.getElementById("progress").value =
      state.screen === "finish" ? 1 : isTrial ? state.page / total : 0;
    const screens = { consent: showConsent, sound: showSoundCheck, practice: showPractice,
      trial: showTrial, finish: showFinish };
    screens[state.screen]();
    if (!store.works) main.append(problem(words.problems.storage));
    if (state.repaired) main.append(problem(words.problems.repaired));
  }

  function goTo(screen) {
    state.screen = screen;
    if (save()) render();
    else stepBack();
  }

  function sheet(heading, ...children) {
    const title = make("h1", {}, heading);
    show(title, make("section", { className: "sheet" }, title, ...children.filter((child) => child !== null)));
  }

  function button(text, onClick, properties) {
    return make("button", { type: "button", onclick: onClick, ...properties }, text);
  }

  function showConsent() {
    const start = button(words.buttons.start, () => goTo(study.sound ? "sound" : "practice"), {
      className: "main",
      disabled: true,
    });
    const box = make("input", { type: "checkbox", id: "agree" });
    box.addEventListener("change", () => (start.disabled = !box.checked));
    sheet(
      words.consent.heading,
      make("p", {}, study.consent || words.consent.text),
      make("p", {}, fill(words.consent.length, { minutes: study.minutes, pages: study.lists[state.list].length })),
      make("label", { className: "agree", htmlFor: "agree" }, box, make("span", {}, words.consent.agree)),
      make("div", { className: "actions next" }, start)
    );
  }

  // ---------------------------------------------------------------- headphones
  // After Woods et al. (2017): of three tones one is quieter; another has opposite phase in the two
  // ears, so that over loudspeakers it, and not the quiet one, is heard as the quietest.

  const ROUNDS = 3;
  const TRIES = 2;

  function showSoundCheck() {
    const text = words.headphones;
    let round = 0;
    let tries = 0;
    let quiet = 0;
    let context = null;
    const message = make("p", { className: "hint", role: "status" });
    const choices = text.choices.map((label, index) =>
      button(label, () => choose(index), { disabled: true })
    );
    const play = button(text.play, playTones, { className: "main" });
    const skip = button(text.skip, () => end("skipped"), {});
    const actions = make("div", { className: "actions" }, skip);

    function end(result) {
      state.headphones = result;
      goTo("practice");
    }

    function playTones() {
      context = context || new AudioContext();
      const kinds = ["quiet", "opposite", "plain"].sort(() => randomBelow(3) - 1);
      quiet = kinds.indexOf("quiet");
      play.disabled = true;
      kinds.forEach((kind, index) => tone(context, context.currentTime + 0.1 + 1.3 * index, kind));
      setTimeout(() => {
        play.disabled = false;
        choices.forEach((choice) => (choice.disabled = false));
      }, 1300 * kinds.length);
    }

    function choose(index) {
      choices.forEach((choice) => (choice.disabled = true));
      if (index === quiet) {
        round += 1;
        message.textContent = "";
        if (round === ROUNDS) end("passed");
        else message.textContent = fill(words.progress.trial, { number: round + 1, total: ROUNDS });
        return;
      }
      round = 0;
      tries += 1;
      message.textContent = tries < TRIES ? text.retry : text.failed;
      if (tries === TRIES) {
        play.hidden = true;
        actions.replaceChildren(button(text.continue, () => end("failed"), { className: "main" }));
      }
    }

    sheet(
      text.heading,
      make("p", {}, text.text),
      make("div", { className: "actions" }, play),
      make("div", { className: "actions" }, ...choices),
      message,
      actions
    );
  }

  function tone(context, start, kind) {
    const buffer = context.createBuffer(2, context.sampleRate, context.sampleRate);
    const level = kind === "quiet" ? 0.15 : 0.3; // 6 dB apart
    const ramp = 0.1 * context.sampleRate;
    for (const channel of [0, 1]) {
      const samples = buffer.getChannelData(channel);
      const sign = kind === "opposite" && channel === 1 ? -1 : 1;
      for (let i = 0; i < samples.length; i += 1) {
        const edge = Math.min(1, i / ramp, (samples.length - i) / ramp);
        samples[i] = sign * level * edge * Math.sin((2 * Math.PI * 200 * i) / context.sampleRate);
      }
    }
    const source = context.createBufferSource();
    source.buffer = buffer;
    source.connect(context.destination);
    source.start(start);
  }

  // ---------------------------------------------------------------- trials

  function openDraft() {
    if (!state.draft) state.draft = { watched: {}, values: {}, reasons: [], before: 0, ms: 0 };
    state.draft.before = state.draft.ms;
    shownSince = performance.now();
  }

  function showTrial() {
    const [id, shown] = study.lists[state.list][state.page];
    const trial = study.trials[id];
    openDraft();
    if (trial.kind === "attention") showAttention(id, trial);
    else {
      showVideos(study.instruction, trial.kind, shown, makeVideo, () => finishPage(id, shown, study.questions));
    }
    preload(state.page + 1);
  }

  /** A page like the first one with videos, of which nothing is kept. */
  function showPractice() {
    const pages = study.lists[state.list].map(([id, shown]) => [study.trials[id].kind, shown]);
    const [kind, shown] = pages.find(([each]) => each !== "attention");
    openDraft();
    showVideos(words.practice.instruction, kind, shown.map((_, index) => `dot-${index}`), makeDot, () => {
      state.draft = null;
      goTo("trial");
    });
    preload(state.page);
  }

  function showAttention(id, trial) {
    const question = { id: "attention", kind: "choice", text: "" };
    const heading = make("h1", { className: "press" },
      fill(words.attention.text, { button: words.buttons[trial.press] }));
    const next = nextButton(() => finishPage(id, [], [question]));
    const choice = choiceQuestion(question, ["left", "tie", "right"], update);

    function update() {
      save();
      next.disabled = state.draft.values.attention === undefined;
    }

    show(heading, heading, choice.element, make("div", { className: "actions next" }, next));
    update();
    onKey = (event) => choice.onKey(event) || enterKey(event, next);
  }

  function showVideos(instruction, kind, shown, makeFilm, onNext) {
    const isPair = kind === "pair" || kind === "match";
    const names = shown.map((_, i) => (isPair ? words.buttons[["left", "right"][i]] : String(i + 1)));
    const stage = makeStage(shown, names, makeFilm, update);
    const values = isPair ? [shown[0], "tie", shown[1]] : shown;
    const parts = study.questions.map((question) => {
      if (question.kind === "choice") return choiceQuestion(question, values, update);
      if (question.kind === "ranking") return rankingQuestion(question, shown, names, update);
      return sliderQuestion(question, shown, names, update);
    });
    if (isPair && study.reasons) parts.push(reasonsQuestion(update));
    const hint = make("p", { className: "hint", role: "status" });
    const next = nextButton(onNext);
    const keys = isPair ? words.progress.keys : words.progress.keys_many;

    function update() {
      save();
      const hasSeen = shown.every((video) => state.draft.watched[video]);
      const hasAnswered = study.questions.every((question) => isAnswered(question, shown));
      parts.forEach((part) => part.enable(hasSeen, hasAnswered));
      next.disabled = !(hasSeen && hasAnswered);
      hint.textContent = !hasSeen ? words.progress.unwatched
        : !hasAnswered && study.questions.length > 1 ? words.progress.unanswered : "";
    }

    const heading = make("h1", { className: "lead" }, instruction);
    show(
      heading,
      heading,
      stage.element,
      hint,
      ...parts.map((part) => part.element),
      make("div", { className: "actions next" }, next),
      make("p", { className: "hint keys" }, fill(keys, { videos: shown.length }))
    );
    update();
    onKey = (event) => stage.onKey(event) || parts.some((part) => part.onKey && part.onKey(event))
      || enterKey(event, next);
  }

  function isAnswered(question, shown) {
    const value = state.draft.values[question.id];
    if (question.kind === "ranking") return Boolean(value) && value.length === shown.length;
    if (question.kind === "slider") return Boolean(value) && shown.every((video) => video in value);
    return value !== undefined;
  }

  function nextButton(onClick) {
    return button(words.buttons.next, onClick, { className: "main", id: "next" });
  }

  function enterKey(event, next) {
    const isControl = event.target.closest("button, a, input[type=checkbox]");
    if (event.key !== "Enter" || isControl || next.disabled) return false;
    next.click();
    return true;
  }

  function finishPage(id, shown, questions) {
    const draft = state.draft;
    const watches = shown.map((video) => draft.watched[video] || 0);
    for (const question of questions) {
      state.answers.push({
        trial: id,
        question: question.id,
        shown,
        value: draft.values[question.id],
        reasons: question.kind === "choice" ? draft.reasons : [],
        watched: watches.length ? Math.min(...watches) : 0,
        ms: elapsed(),
      });
    }
    state.draft = null;
    state.page += 1;
    state.repaired = false;
    const isOver = state.page >= study.lists[state.list].length;
    if (isOver) state.finished = new Date().toISOString();
    state.unsent = Boolean(postTo);
    goTo(isOver ? "finish" : "trial");
    sendSoon();
  }

  function preload(page) {
    const next = study.lists[state.list][page];
    for (const id of next ? next[1] : []) {
      const video = make("video", { preload: "auto", muted: true });
      video.src = `media/${id}.mp4`;
    }
  }

  // ---------------------------------------------------------------- videos

  /** The videos of a page. One plays at a time, from its start, without a way to skip ahead. */
  function makeStage(shown, names, makeFilm, onChange) {
    const cards = shown.map((id, index) => makeCard(id, names[index]));
    const count = shown.length > 3 ? "many" : String(shown.length);
    const element = make("div", { className: "videos", data: { count } }, ...cards.map((card) => card.element));

    function makeCard(id, name) {
      const video = makeFilm(id, name);
      const action = make("span", { className: "action" });
      const play = button("", () => toggle(card), { className: "play" });
      play.append(make("span", { className: "sign", "aria-hidden": "true" }),
        make("span", { className: "name" }, name), action);
      const card = { id, video, element: make("div", { className: "card" }, video, play), refresh,
        isWhole: false };

      function refresh() {
        const isPlaying = !video.paused;
        const watches = state.draft ? state.draft.watched[id] || 0 : 0;
        card.element.classList.toggle("playing", isPlaying);
        card.element.classList.toggle("seen", watches > 0);
        action.textContent = isPlaying ? words.buttons.pause
          : watches ? words.buttons.replay : words.buttons.play;
        element.classList.toggle("busy", cards.some((other) => !other.video.paused));
      }

      video.addEventListener("play", refresh);
      video.addEventListener("pause", refresh);
      video.addEventListener("click", () => toggle(card));
      video.addEventListener("contextmenu", (event) => event.preventDefault());
      video.addEventListener("error", () => main.append(problem(words.problems.video)), { once: true });
      video.addEventListener("seeking", () => {
        if (video.currentTime > 0) card.isWhole = false; // by a media key or a browser's own menu
      });
      video.addEventListener("ratechange", () => (card.isWhole = false));
      video.addEventListener("ended", () => {
        if (card.isWhole) state.draft.watched[id] = (state.draft.watched[id] || 0) + 1;
        refresh();
        onChange();
      });
      return card;
    }

    function toggle(card) {
      const wasPlaying = !card.video.paused;
      cards.forEach((other) => {
        other.video.pause();
        other.video.currentTime = 0;
      });
      card.isWhole = true;
      if (!wasPlaying) card.video.play().catch(() => card.refresh());
    }

    function press(event) {
      const index = Number(event.key) - 1;
      if (!(index in cards) || event.target.closest("input[type=range]")) return false;
      toggle(cards[index]);
      return true;
    }

    cards.forEach((card) => card.refresh());
    return { element, onKey: press };
  }

  function makeVideo(id, name) {
    const video = make("video", {
      preload: "auto",
      playsInline: true,
      muted: !study.sound,
      disablePictureInPicture: true,
      "aria-label": name,
    });
    video.setAttribute("playsinline", "");
    video.src = `media/${id}.mp4`;
    return video;
  }

  const DOT_S = 1.5;
  const DOT_PX = 256;

  /** What stands in for a video in the practice: a dot that crosses the picture, each in its way. */
  function makeDot(id, name) {
    const canvas = make("canvas", { width: DOT_PX, height: DOT_PX, role: "img", "aria-label": name });
    const number = Number(id.split("-")[1]);
    let began = null;

    function draw(share) {
      const context = canvas.getContext("2d");
      const steps = 4 + 3 * number;
      const across = number % 2 ? Math.floor(share * steps) / steps : share;
      const y = 0.5 + 0.25 * Math.sin(2 * Math.PI * (across + number / 4));
      context.fillStyle = "#d9d9d9";
      context.fillRect(0, 0, DOT_PX, DOT_PX);
      context.fillStyle = "#0f6d8c";
      context.beginPath();
      context.arc((0.12 + 0.76 * across) * DOT_PX, y * DOT_PX, 0.07 * DOT_PX, 0, 2 * Math.PI);
      context.fill();
    }

    function stop() {
      began = null;
      canvas.dispatchEvent(new Event("pause"));
    }

    function go() {
      if (began === null) return;
      const share = (performance.now() - began) / (1000 * DOT_S);
      draw(Math.min(share, 1));
      if (share < 1) requestAnimationFrame(go);
      else {
        stop();
        canvas.dispatchEvent(new Event("ended"));
      }
    }

    Object.defineProperties(canvas, {
      paused: { get: () => began === null },
      currentTime: {
        get: () => 0,
        set: () => {
          draw(0);
        },
      },
    });
    canvas.pause = () => began !== null && stop();
    canvas.play = async () => {
      began = performance.now();
      canvas.dispatchEvent(new Event("play"));
      requestAnimationFrame(go);
    };
    draw(0);
    return canvas;
  }

  // ---------------------------------------------------------------- questions

  function makeFieldset(legend, className, ...children) {
    const group = make("div", { className }, ...children);
    return make("fieldset", {}, legend ? make("legend", {}, legend) : null, group);
  }

  /** Left, equal, right. */
  function choiceQuestion(question, values, onChange) {
    const labels = [words.buttons.left, words.buttons.tie, words.buttons.right];
    const inputs = values.map((value, index) => {
      const input = make("input", {
        type: "radio",
        name: question.id,
        id: `${question.id}-${index}`,
        checked: state.draft.values[question.id] === value,
      });
      input.addEventListener("change", () => {
        state.draft.values[question.id] = value;
        onChange();
      });
      return input;
    });
    const parts = inputs.flatMap((input, index) => [input, make("label", { htmlFor: input.id }, labels[index])]);
    const element = makeFieldset(question.text, "choices", ...parts);

    function press(event) {
      const index = ["ArrowLeft", "ArrowDown", "ArrowRight"].indexOf(event.key);
      if (index < 0 || element.disabled) return false;
      inputs[index].click();
      inputs[index].focus();
      return true;
    }

    return { element, enable: (hasSeen) => (element.disabled = !hasSeen), onKey: press };
  }

  /** Videos are tapped from best to worst; the last one follows by itself. */
  function rankingQuestion(question, shown, names, onChange) {
    const order = () => state.draft.values[question.id] || [];
    const buttons = shown.map((video, index) => button(names[index], () => choose(video), {}));
    const undo = button(words.buttons.undo, () => set([]), { className: "undo" });
    const element = makeFieldset(question.text, "ranks", ...buttons, undo);
    const note = make("p", { className: "hint" }, words.progress.order);
    element.append(note);

    function choose(video) {
      if (order().includes(video)) return set(order().filter((other) => other !== video));
      const chosen = [...order(), video];
      const left = shown.filter((other) => !chosen.includes(other));
      return set(left.length === 1 ? [...chosen, left[0]] : chosen);
    }

    function set(value) {
      state.draft.values[question.id] = value;
      refresh();
      onChange();
    }

    function refresh() {
      buttons.forEach((one, index) => {
        const rank = order().indexOf(shown[index]) + 1;
        if (rank) one.dataset.rank = rank;
        else delete one.dataset.rank;
        one.setAttribute("aria-label", rank ? `${names[index]}: ${rank}` : names[index]);
      });
      undo.hidden = order().length === 0;
      note.hidden = order().length === shown.length;
    }

    refresh();
    return { element, enable: (hasSeen) => (element.disabled = !hasSeen) };
  }

  /** One slider for each video, from 0 to 100; it counts once it has been touched. */
  function sliderQuestion(question, shown, names, onChange) {
    const values = () => state.draft.values[question.id] || {};
    const rows = shown.map((video, index) => {
      const has = video in values();
      const input = make("input", {
        type: "range", min: 0, max: 100, step: 1, "aria-label": `${names[index]}: ${question.text}`,
        className: has ? "" : "untouched",
      });
      input.value = has ? values()[video] : 50;
      const number = make("output", {}, has ? input.value : "–");
      const take = () => {
        input.className = "";
        number.textContent = input.value;
        state.draft.values[question.id] = { ...values(), [video]: Number(input.value) };
        onChange();
      };
      for (const name of ["input", "pointerup"]) input.addEventListener(name, take);
      return make("div", { className: "slider" }, make("b", {}, names[index]), input, number);
    });
    const ends = make("div", { className: "ends" }, make("span", {}, words.slider.low), make("span", {}, words.slider.high));
    const element = makeFieldset(question.text, "sliders", ends, ...rows);
    return { element, enable: (hasSeen) => (element.disabled = !hasSeen) };
  }

  /** Any number of reasons for a choice; they appear once it is made. */
  function reasonsQuestion(onChange) {
    const parts = study.reasons.choices.flatMap((reason) => {
      const input = make("input", {
        type: "checkbox",
        id: `reason-${reason.id}`,
        checked: state.draft.reasons.includes(reason.id),
      });
      input.addEventListener("change", () => {
        const others = state.draft.reasons.filter((id) => id !== reason.id);
        state.draft.reasons = input.checked ? [...others, reason.id] : others;
        onChange();
      });
      return [input, make("label", { htmlFor: input.id }, reason.text)];
    });
    const element = makeFieldset(study.reasons.text, "reasons", ...parts);
    return { element, enable: (hasSeen, hasAnswered) => (element.hidden = !hasAnswered) };
  }

  // ---------------------------------------------------------------- the end

  function showFinish() {
    const text = words.finish;
    const message = make("p", { role: "status" }, state.sent ? text.sent : postTo ? text.post : text.file);
    const download = button(words.buttons.download, saveFile, { className: postTo ? "" : "main" });
    const send = postTo && !state.sent
      ? button(words.buttons.send, () => sendAnswers(message, send), { className: "main" }) : null;
    const isOver = state.sent || state.saved;
    sheet(
      text.heading,
      make("p", {}, text.text),
      message,
      isOver || !study.returnTo ? null : make("p", {}, text.then),
      make("div", { className: "actions" }, send, download, isOver ? backLink() : null),
      // Only now: whoever starts anew can no longer reach the answers of the one before.
      isOver
        ? make("div", { className: "actions" }, button(words.buttons.again, startAgain, {})) : null
    );
  }

  /** To the service that sent the participant; a preview shows where it leads and goes nowhere. */
  function backLink() {
    if (!study.returnTo) return null;
    if (isPreview) return make("span", {}, `${words.finish.back}: ${study.returnTo}`);
    return make("a", { href: study.returnTo, className: "main" }, words.finish.back);
  }

  function saveFile() {
    const content = new Blob([JSON.stringify(answersFile(), null, 1)], { type: "application/json" });
    const link = make("a", { download: `${isPreview ? "preview" : "answers"}-${study.study}-${state.participant}.json` });
    link.href = URL.createObjectURL(content);
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    state.saved = true;
    goTo("finish");
  }

  async function sendAnswers(message, send) {
    send.disabled = true;
    if (await sendSoon()) return;
    message.textContent = words.finish.failed;
    send.disabled = false;
  }

  // All answers so far are sent after each page, and again until they have arrived.

  const FIRST_WAIT_MS = 5000;
  const LONGEST_WAIT_MS = 60000;
  let sending = null;
  let wait = FIRST_WAIT_MS;

  function sendSoon() {
    if (!state.unsent) return Promise.resolve(state.sent);
    sending = sending || sendAll().finally(() => (sending = null));
    return sending;
  }

  async function sendAll() {
    const { participant } = state;
    while (state.unsent && state.participant === participant) {
      const count = state.answers.length;
      if (!(await post())) {
        setTimeout(sendSoon, wait);
        wait = Math.min(2 * wait, LONGEST_WAIT_MS);
        return false;
      }
      wait = FIRST_WAIT_MS;
      if (state.answers.length !== count || state.participant !== participant) continue;
      state.unsent = false;
      state.sent = state.finished !== null;
      if (state.sent) goTo("finish");
      else save();
    }
    return state.sent;
  }

  async function post() {
    try {
      const reply = await fetch(postTo, {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(answersFile()),
      });
      return reply.ok;
    } catch {
      return false;
    }
  }

  window.addEventListener("online", () => state && sendSoon());

  function startAgain() {
    state = newState();
    takeOver();
    save();
    render();
  }

  // ---------------------------------------------------------------- start

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !onKey) return;
    if (onKey(event)) event.preventDefault();
  });

  if (isPreview) document.body.prepend(make("p", { className: "preview", role: "note" }, words.preview.text));
  if (asked !== null && !(/^\d{1,6}$/.test(asked) && Number(asked) < study.lists.length)) {
    show(null, problem(fill(words.problems.list, { list: asked, last: study.lists.length - 1 })));
  } else {
    state = loadState();
    takeOver();
    save();
    render();
    sendSoon();
  }
})();
